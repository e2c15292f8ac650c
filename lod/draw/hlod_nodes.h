#pragma once
// Draws the nodes of a hlod.lgh with OpenGL ES (Guthe et al. 2004, sections 3.2 and 4), for the server and the client:
// triangles, points where they were small, and lines along the edges where cracks may open.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>

#include "base/camera.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"
#include "lod/hlod/stream.h"

namespace lod::draw {

struct NodeView {
  base::Camera camera;  ///< perspective, off-axis too, or parallel
  Shading shading;
  glm::vec4 section = base::kNoSection;  ///< everything beyond it is cut away
  /// kResolutionLegend by the node's projected error, hatched with dark lines where a finer node is still to come;
  /// otherwise the colours of the scan, shaded.
  bool resolution_colors = false;
};

struct NodeTarget {
  GLuint framebuffer = 0;  ///< colour and depth, cleared or with a picture to draw into
  int width = 0;           ///< samples; the camera's picture covers all of them
  int height = 0;
};

struct NodeCount {
  std::uint64_t triangles = 0, points = 0, lines = 0;
};

/// Nodes are uploaded when first drawn. Those whose picture nobody holds any more are dropped with the next draw, and
/// those that no draw has used for the longest time where the limit asks for it.
class NodeRenderer {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for nodes on the GPU; those of the frame
  /// that is being drawn stay in any case.
  static base::Result<std::unique_ptr<NodeRenderer>> create(std::uint64_t gpu_bytes);
  ~NodeRenderer();
  /// Draws both sides of all surfaces. The depth test (less) stays enabled.
  base::Result<NodeCount> draw(std::span<const hlod::DrawnNode> nodes, const NodeView& view, const NodeTarget& target);
  std::uint64_t gpuBytes() const;

 private:
  NodeRenderer();
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace lod::draw
