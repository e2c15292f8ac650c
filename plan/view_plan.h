#pragma once
// What a view needs, in the order of need: groups of patches and faces (DESIGN section 6, steps 2 to 4). Pure functions
// of scene and view. Two plan by it: a server for its clients, and a client that reads a published scene by itself.
// What the client has already is left to them.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"
#include "lod/patch/traverse.h"
#include "protocol/message.h"
#include "repository/sampling/sample_tree.h"

namespace plan {

/// What a plan is made from; all of it outlives the call.
struct Scene {
  const protocol::Welcome* welcome = nullptr;           ///< origin, box, grid
  const lod::patch::Hierarchy* hierarchy = nullptr;     ///< whole, or as far as it is known
  bool images = false;                                  ///< whether there is a repository
  const repository::SampleTree* sample_tree = nullptr;  ///< which points are sampled; null: all of the grid
  const lod::patch::ProxySight* sight = nullptr;        ///< what hides what; null: nothing does
};

/// What both send or fetch first: a coarse whole model of so many bytes, 0.1 s at 4 Mbit/s.
inline constexpr std::uint64_t kCoarseBytes = 50'000;
/// ... and ahead of need, for one view, when all that it needs is there.
inline constexpr std::uint64_t kPrefetchBytes = 1'000'000;
/// An image thrown on a proxy that is off by more than this many times the tolerance is a blur: groups alone until
/// then.
inline constexpr float kUrgent = 4.0F;

/// Faces of a view at most, for each point that it asks for: a client blends 16 images where it asks for 8 points. All
/// that the points show (30 faces) instead were 8.0 MB for 16 views over machangara in place of 6.6, for 0.02 dB more.
inline constexpr std::size_t kFacesPerPoint = 2;
/// ... but so many where it asks for few: a point or two must show all that is in view.
inline constexpr std::size_t kMinFaces = 8;

struct ViewPlan {
  std::vector<std::uint32_t> groups;  ///< that the client's cut expands: parents first, largest projected error first
  std::vector<float> group_error_px;  ///< beside `groups`
  std::vector<repository::FaceKey> faces;  ///< that show what is in view, in the order of what each adds to the picture
  std::vector<repository::FaceKey> other_faces;  ///< all others of the same points
};

using HasFace = std::function<bool(const repository::FaceKey&)>;

/// Most sampling points that one view is given, whatever it asks for.
inline constexpr std::size_t kMaxPointsPerView = 64;

/// The camera of a view in scene-local terms, with the limits that the client's cut keeps.
lod::patch::CutRequest cutRequestFor(const protocol::Welcome& welcome, const protocol::View& view);

/// Whether a group that misses `error_px` pixels goes before any face.
bool isUrgent(float error_px, const protocol::View& view);

/// The plan for one view. Groups are those of the whole hierarchy's cut under the view's tolerance and triangle budget:
/// the client, choosing by the same rule among what it has, arrives at that cut when all have come. Faces for which
/// `present` holds are left out.
ViewPlan planView(const Scene& scene, const protocol::View& view, const HasFace& present);

/// Faces for where the eye will be when it moves on as it did from `previous` to `newest`; empty when it stood still.
std::vector<repository::FaceKey> planMotion(const Scene& scene, const protocol::View& newest,
                                            const protocol::View& previous, const HasFace& present);

/// The coarse whole model: groups by falling error (world units), group 0 first, as long as their blocks stay within
/// `bytes`. Parents come before their children.
std::vector<std::uint32_t> coarseGroups(const lod::patch::Hierarchy& hierarchy, std::uint64_t bytes);

}  // namespace plan
