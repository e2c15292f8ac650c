#pragma once
// The content of one tile of 3D Tiles: glTF, alone or within a batched model (b3dm), or points (pnts). Section names in
// the source refer to the specification 3D Tiles 1.1 (OGC 22-025r4).
#include <glm/glm.hpp>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/gltf/reader.h"

namespace mesh::tiles {

/// Tells formats of contents apart by their first bytes.
enum class ContentKind {
  kGlb,
  kBatchedModel,     ///< b3dm
  kInstancedModels,  ///< i3dm
  kPoints,           ///< pnts
  kComposite,        ///< cmpt
  kJson,             ///< glTF, or another tileset
  kGzip,             ///< any of them, compressed for a web server
  kUnknown
};
ContentKind kindOf(base::ByteView begin);

/// The axis of a content that points up. 3D Tiles turn it to z (section "glTF transforms").
enum class UpAxis { kX, kY, kZ };

/// Reads a content of the kinds kGlb, kBatchedModel, kPoints and kJson (glTF). `bytes` are all of the file `path`.
/// Errors do not name the file.
base::Result<void> readContent(base::ByteView bytes, const std::string& path, const glm::dmat4& world_from_tile,
                               UpAxis up, const gltf::ShareOfSource& share, gltf::Omissions& omissions,
                               MeshStream& out);

}  // namespace mesh::tiles
