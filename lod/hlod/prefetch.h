#pragma once
// Which nodes a view wants next if it moves (Guthe et al. 2004, section 4.3).
#include <cstdint>
#include <span>
#include <vector>

#include "lod/hlod/traverse.h"

namespace lod::hlod {

/// A node that a view does not draw.
struct NextNode {
  /// The motion that makes the view want it: the angle by which it turns, radians, or the step that it makes, in parts
  /// of the distance; both move the picture about as much. Of a parallel view, the step in parts of its height.
  float motion = 0.0F;
  std::uint32_t node = 0;
};

/// Nodes just outside of the view, as fine as it draws what is inside, and the children of the nodes that it draws; by
/// rising motion. `max_bytes`: only the first ones, whose pictures have about so many bytes together.
std::vector<NextNode> nodesWantedNext(std::span<const Node> nodes, const TraverseRequest& request,
                                      std::uint64_t max_bytes);

/// A view from the light, whose shadow map casters are drawn into.
struct LightRequest {
  base::Camera camera;
  float max_error = 0.0F;  ///< casters are off by at most so much, scene units
};

/// The same for the casters of a map: a light that moves, or a viewer, turns and zooms the views from it (figure 5).
std::vector<NextNode> castersWantedNext(std::span<const Node> nodes, const LightRequest& request,
                                        std::uint64_t max_bytes);

/// Whether both want the same nodes.
bool isSameRequest(const TraverseRequest& a, const TraverseRequest& b);

}  // namespace lod::hlod
