#pragma once
// Draws the nodes of a hlod.lgh with OpenGL ES (Guthe et al. 2004, sections 3.2 and 4), for the server and the client:
// triangles, points where they were small, and lines along the edges where cracks may open.
#include <cstdint>
#include <memory>
#include <span>

#include "lod/draw/picture_cache.h"
#include "lod/draw/surfaces.h"
#include "lod/hlod/stream.h"

namespace lod::draw {

/// Its resolution is the node's projected error.
using NodeView = SurfaceView;
using NodeTarget = SurfaceTarget;

struct NodeCount {
  std::uint64_t triangles = 0, points = 0, lines = 0;
};

/// Nodes are kept on the GPU as a PictureCache does: 20 bytes a vertex; 6 a triangle and 4 a line, or twice that where
/// the node has more than 65536 vertices.
///
/// Points are as large, and lines as wide, as the node's error demands for the surface to have no hole: the cells on
/// both sides of a crack, and points around a place, are off by at most their errors. They span a sample at least:
/// where the picture has several samples a pixel, larger ones would only make silhouettes thicker.
class NodeRenderer {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for nodes on the GPU; those of the frame
  /// that is being drawn stay in any case.
  static base::Result<std::unique_ptr<NodeRenderer>> create(std::uint64_t gpu_bytes);
  /// Draws both sides of all surfaces. The depth test (less) stays enabled.
  base::Result<NodeCount> draw(std::span<const hlod::DrawnNode> nodes, const NodeView& view, const NodeTarget& target);
  std::uint64_t gpuBytes() const { return meshes_.bytes(); }

 private:
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer vertices;
    base::gl::Buffer indices;  ///< of the triangles, then of the lines
    GLenum index_type = GL_UNSIGNED_SHORT;
    std::uint64_t bytes = 0;
  };
  explicit NodeRenderer(std::uint64_t gpu_bytes) : meshes_(gpu_bytes) {}
  static Mesh upload(const hlod::NodePicture& picture);
  base::Result<std::uint64_t> drawPass(Primitive primitive, std::span<const hlod::DrawnNode> nodes,
                                       const NodeView& view, const NodeTarget& target);

  SurfacePrograms programs_{SurfaceStyle{.name = "nodes", .shade_fragments = true, .fill_behind = true}};
  PictureCache<hlod::NodePicture, Mesh> meshes_;
};

}  // namespace lod::draw
