#pragma once
// Point tiles (pnts) of 3D Tiles.
#include <glm/glm.hpp>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/gltf/reader.h"
#include "mesh/mesh_stream.h"

namespace mesh::tiles {

/// Hands the points of a tile to `out`, with colours and normals where it has some. Their z points up in the tile, as
/// that of no glTF does. Errors do not name the file: kInvalidInput, and kUnsupported for points that Draco compressed.
base::Result<void> readPoints(base::ByteView bytes, const glm::dmat4& world_from_tile, const gltf::ShareOfSource& share,
                              MeshStream& out);

}  // namespace mesh::tiles
