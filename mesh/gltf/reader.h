#pragma once
// The triangles, or the points, of a glTF document: its scene graph, its primitives and their colours.
#include <cstdint>
#include <glm/glm.hpp>
#include <set>
#include <string>
#include <vector>

#include "base/error.h"
#include "mesh/gltf/document.h"
#include "mesh/mesh_stream.h"

namespace mesh::gltf {

/// Counts, over all documents of a source, the things that are not read as they are written.
struct Omissions {
  std::uint64_t point_primitives = 0;  ///< while triangles are read
  std::uint64_t line_primitives = 0;
  std::uint64_t unread_textures = 0;                     ///< of kinds or in places that are not read
  std::string first_unread;                              ///< says why, for the first of them
  std::set<std::string> unknown_extensions;              ///< that a document requires
  std::uint64_t triangles = 0, triangles_in_meshes = 0;  ///< drawn by nodes, and held by the files

  /// One line each.
  void describe(std::vector<std::string>& warnings) const;
};

/// The part of the whole source that a document is, for progress: from `begin` to `end`, 0..1.
struct ShareOfSource {
  double begin = 0.0;
  double end = 1.0;
};

/// Hands the triangles of the document's scene to `out`, to where `out_from_document` moves them; where
/// out.reads_points holds, its points.
base::Result<void> readScene(Document& document, const glm::dmat4& out_from_document, const ShareOfSource& share,
                             Omissions& omissions, MeshStream& out);

}  // namespace mesh::gltf
