#pragma once
// Plans which groups of patches and which faces a view needs, most urgent first (Okamoto 2011, section 5.1, steps 2 to
// 4). The functions are pure functions of scene and view. A server plans for its clients with them, and a client that
// reads a published scene by itself plans for itself. Both keep track of what the client has already.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"
#include "lod/patch/traverse.h"
#include "plan/gain_order.h"
#include "protocol/message.h"
#include "repository/sampling/sample_tree.h"

namespace plan {

/// The bytes of a typical image: a guess, which gives way to the mean of those that came.
class ImageBytes {
 public:
  void add(std::uint64_t bytes) { sum_ += bytes, ++count_; }
  /// At least 1. The guess, of scans at the usual quality, counts as four images.
  std::uint64_t typical(const repository::Grid& grid) const;

 private:
  std::uint64_t sum_ = 0, count_ = 0;
};

/// The input of a plan. Everything it points to must outlive the call.
struct Scene {
  const protocol::Welcome* welcome = nullptr;           ///< origin, box, grid
  const lod::patch::Hierarchy* hierarchy = nullptr;     ///< whole, or as far as it is known
  bool images = false;                                  ///< the scene has a repository
  const repository::SampleTree* sample_tree = nullptr;  ///< the points that are sampled; null: all of the grid
  const lod::patch::ProxySight* sight = nullptr;        ///< tests occlusion; null: nothing hides anything
  SightCache* sight_cache = nullptr;                    ///< remembers what `sight` said; may be null
  /// As GainQuery has it.
  StoredBytes stored_bytes = nullptr;
  ImageBytes image_bytes = {};
  bool is_fast = false;   ///< the eye moves, and fast (isFast())
  bool is_fresh = false;  ///< of files: the plan before was of another camera, or there was none
  /// The eye stands, and asks for more than the view's first plan had (GainQuery::counts_foreground).
  bool rests = true;
  double link_rate = 0.0;         ///< bytes a second towards the viewer; 0: not known
  std::uint64_t patch_bytes = 0;  ///< of files: of all groups; 0: not known
  /// One in so many of the rays across the picture, and of those up, is cast: from 1 to 8. At 2 a plan takes less than
  /// half of the time, and tells less well what the view gains from.
  int ray_step = 1;
};

/// The coarse whole model that is sent or fetched first has at most this many bytes: 0.1 s at 4 Mbit/s.
inline constexpr std::uint64_t kCoarseBytes = 40'000;
/// Bytes that are sent or fetched ahead of need for one view, once everything that it needs is there: 2 s at 4 Mbit/s.
inline constexpr std::uint64_t kPrefetchBytes = 1'000'000;
/// A view gets at most this many faces for each point that it asks for: a client that asks for 8 points blends 16
/// images. Sending all 30 faces that the points show took 8.0 MB for 16 views over machangara in place of 6.6 MB, for
/// 0.02 dB more.
inline constexpr std::size_t kFacesPerPoint = 2;
/// A view that asks for one or two points still gets this many faces, since they must show everything in view.
inline constexpr std::size_t kMinFaces = 8;

/// The same of tiles: a picture of 1280 × 720 pixels is covered by some twenty.
inline constexpr std::size_t kTilesPerPoint = 8;
inline constexpr std::size_t kMinTiles = 24;

struct ViewPlan {
  std::vector<std::uint32_t> groups;  ///< expanded in the client's cut and not there: parents first, then most gain
  /// Beside `groups`: whether the shape needs it (OrderedGroup::is_needed).
  std::vector<bool> is_needed;
  /// Beside `groups`: each comes after so many of `faces`.
  std::vector<std::size_t> faces_before;
  std::vector<repository::FaceKey> faces;  ///< images that show what is in view, most useful first
  /// Beside the first of `faces`: by how much each lessens the expected squared error, after those before it.
  std::vector<float> face_gains;
  std::vector<repository::FaceKey> other_faces;  ///< all other faces of the same points
  std::vector<glm::uvec3> points;                ///< whose images were chosen from
  /// Expected squared error of the picture's colours, 0..1, as it is, and once groups and faces have come.
  float error_before = 0.0F, error_after = 0.0F;
};

using HasFace = std::function<bool(const repository::FaceKey&)>;
using HasGroup = std::function<bool(std::uint32_t)>;

/// Tells which faces and groups the viewer has.
struct Holdings {
  HasFace face = [](const repository::FaceKey&) { return false; };
  HasGroup group = [](std::uint32_t) { return false; };
};

/// The server's limit on the sampling points of one view (docs/formats/protocol.md, View).
inline constexpr std::size_t kMaxPointsPerView = 64;

/// Whether the eye went on from one view to the next: by no jump, and not by nothing.
bool isMoving(const protocol::Welcome& welcome, const protocol::View& newest, const protocol::View& previous);

/// Whether an eye that went from one camera to another in so many seconds moves fast, so that it soon has other surface
/// before it: it turns by more than 0.4 radians a second, or goes more than a third of the scene's diagonal, world
/// units, a second. Two views at a time tell no speed.
bool isFast(const base::ViewCamera& from, const base::ViewCamera& to, double seconds, double diagonal);

/// From so many bytes a second on, patches that bring no more than colours are fetched from files for a moving eye that
/// gets images, too: 10 Mbit/s. A choice: at 1 Mbit/s they come too late, and images with them; at 20 they bring 1 to
/// 3 dB. A server sends them on any link. Groups that gain little are sent from so many on.
inline constexpr double kFastLink = 1'250'000.0;
/// On slower links they are fetched, too, where all patches take no longer than this, seconds. Measured:
/// docs/decisions/gain-per-byte.md.
inline constexpr double kSoonWhole = 5.0;

/// The view as it is planned: a fresh one of files by errors of shape where colours of patches would come too late.
protocol::View viewToPlan(const Scene& scene, const protocol::View& view);

/// The camera of a view in scene-local terms, with the limits that the client's cut keeps.
lod::patch::CutRequest cutRequestFor(const protocol::Welcome& welcome, const protocol::View& view);

/// Plans for one view. The groups are those that the whole hierarchy's cut expands under the view's tolerance and
/// triangle budget. The client chooses by the same rule among the groups it has, so it arrives at that cut when all of
/// them have come. Where a view with images goes by visible errors, groups that gain too little are missing, unless the
/// eye moves, or has just come, and the link is fast. What the viewer has is left out; groups and images are ordered by
/// gain for their bytes (plan/gain_order.h).
ViewPlan planView(const Scene& scene, const protocol::View& view, const Holdings& present = {});

/// Plans faces for the view after `newest`, assuming that the eye repeats its step from `previous` to `newest`; empty
/// when the eye stood still.
std::vector<repository::FaceKey> planMotion(const Scene& scene, const protocol::View& newest,
                                            const protocol::View& previous, const Holdings& present = {});

/// The groups of the coarse whole model, by decreasing error (world units) and beginning with group 0, as long as their
/// blocks stay within `bytes`. Parents come before their children.
std::vector<std::uint32_t> coarseGroups(const lod::patch::Hierarchy& hierarchy, std::uint64_t bytes);

}  // namespace plan
