#pragma once
// What a view needs, in the order of need: groups of patches and faces (DESIGN section 6, steps 2 to 4). Pure functions
// of scene and view; what the client has already is left to the session.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "protocol/message.h"
#include "server/session/session.h"

namespace server {

struct ViewPlan {
  std::vector<std::uint32_t> groups;  ///< that the client's cut expands: parents first, largest projected error first
  std::vector<float> group_error_px;  ///< beside `groups`
  std::vector<repository::FaceKey> faces;  ///< that show what is in view, in the order of what each adds to the picture
  std::vector<repository::FaceKey> other_faces;  ///< the other directions at the same points
};

using HasFace = std::function<bool(const repository::FaceKey&)>;

/// Most sampling points that one view is given, whatever it asks for.
inline constexpr std::size_t kMaxPointsPerView = 64;

/// The plan for one view. Groups are those of the whole hierarchy's cut under the view's tolerance and triangle budget:
/// the client, choosing by the same rule among what it has, arrives at that cut when all have come. Faces for which
/// `present` holds are left out.
ViewPlan planView(const SceneData& scene, const protocol::View& view, const HasFace& present);

/// Faces for where the eye will be when it moves on as it did from `previous` to `newest`; empty when it stood still.
std::vector<repository::FaceKey> planMotion(const SceneData& scene, const protocol::View& newest,
                                            const protocol::View& previous, const HasFace& present);

/// The coarse whole model: groups by falling error (world units), group 0 first, as long as their blocks stay within
/// `bytes`. Parents come before their children.
std::vector<std::uint32_t> coarseGroups(const lod::patch::Hierarchy& hierarchy, std::uint64_t bytes);

}  // namespace server
