#pragma once
// Finds, for the nodes that a view draws, the maps of their shadows and the casters that are here, for the server and
// the client (Guthe et al. 2004, section 4.1).
#include <cstdint>
#include <optional>
#include <span>

#include "lod/draw/hlod_nodes.h"
#include "lod/hlod/stream.h"
#include "lod/hlod/traverse.h"

namespace lod::draw {

/// The most texels of a side of the maps of hard shadows, and of each layer of those of soft ones.
inline constexpr std::uint32_t kHardTexels = 4096, kSoftTexels = 2048;

struct NodeLight {
  hlod::ShadowLight light;          ///< its size is 0 for hard shadows
  std::uint32_t max_texels = 2048;  ///< of a side of a map, at least 1, at most what the GL allows
  /// As ShadowRequest::room, for one view after another; 0 for single pictures.
  float room = 0.0F;
  std::uint64_t kept_bytes = 0;  ///< as NodeShadows::kept_bytes
  /// Texels may be so many times larger than those of a view at rest, 1 or more: as the tolerance of a view that moves.
  float coarser = 1.0F;
};

/// The room for views of a viewer who moves: maps hold for about a tenth of a turn around a model that fills the view,
/// and for any turn if all of it is seen.
inline constexpr float kRoomToMove = 0.15F;

class NodeShadowFinder {
 public:
  /// `nodes` are those that stream.update(request) has found just now. Casters that are not here are requested, and
  /// nodes above them cast in their place meanwhile. Nothing waits: stream.complete() says whether all of them are
  /// here.
  NodeShadows find(hlod::Stream& stream, std::span<const hlod::DrawnNode> nodes, const hlod::TraverseRequest& request,
                   const NodeLight& light);
  /// The same for anything else that is drawn in their light: receivers are parts of it, and a map's receivers places
  /// in this list. The stream has found nodes for the view, whichever.
  NodeShadows find(hlod::Stream& stream, std::span<const hlod::ShadowReceiver> receivers,
                   const hlod::TraverseRequest& request, const NodeLight& light);

 private:
  hlod::ShadowPlanner planner_;
};

/// As hlod::planSceneShadowMap(), for views like `request`, and with the casters that are here. The stream has found
/// nodes for a view, whichever.
std::optional<NodeShadowMap> findSceneShadows(hlod::Stream& stream, const hlod::TraverseRequest& request,
                                              double pixels_per_unit, const NodeLight& light);

/// Returns NodeLight::max_texels for maps that take at most so many bytes each, all layers of a soft one together.
std::uint32_t shadowTexelsFor(std::uint64_t bytes, bool soft);

}  // namespace lod::draw
