#pragma once
// Which splats to draw for a view (Rusinkiewicz and Levoy 2000, section 2.1), and which blocks would make the picture
// finer (Rusinkiewicz and Levoy 2001, sections 3.2 and 4.2).
//
// A node is drawn as it is where its sphere's projected diameter is at most the cut-off, where it is a leaf, or where
// the block of its children is not here. All else that may be seen is replaced by its children. The spheres of what is
// drawn hold all of the surface that faces the viewer within the frustum, at any cut-off and whatever is missing: so
// kernels that cover their sphere's projection leave no hole.
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "base/camera.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/splat.h"

namespace lod::qsplat {

/// A node whose children are not here.
struct MissingChildren {
  std::uint64_t block = 0;  ///< that holds the children
  std::uint32_t level = 0;  ///< of the node; the root is 0
  float radius = 0.0F;      ///< of the node, scene units
  float size_px = 0.0F;     ///< projected diameter of the node; infinite where its centre lies behind the eye
  /// Where the node's centre is seen, pixels from the picture's upper left corner; may lie outside, and means nothing
  /// where size_px is infinite.
  glm::vec2 at_px{0.0F};
};

/// The larger, the sooner. Called from several threads at a time where `for_each` is given.
using Priority = std::function<float(const MissingChildren&)>;
/// Sweeps from the picture's top to its bottom, each about twice as fine as the one before: ⌈log_√2 size⌉ · 1000 + y,
/// y = 0 … 999 from the bottom up (Rusinkiewicz and Levoy 2001, section 4.2).
Priority sweepPriority(int picture_height);

/// A magnifying glass (Rusinkiewicz and Levoy 2001, section 4.3).
struct Lens {
  glm::vec2 center_px{0.0F};  ///< from the picture's upper left corner
  float radius_px = 0.0F;     ///< above 0
  friend bool operator==(const Lens&, const Lens&) = default;
};
/// Whether a sphere is seen through the lens, if only in part. `at_px`, `size_px`: as MissingChildren has them.
bool isSeenThrough(const Lens& lens, const glm::vec2& at_px, float size_px);
/// The cut-off of what is seen through a lens, where that of the rest is `cutoff_px`: a third of it, but no smaller
/// than can be told from that.
float cutoffThroughLens(float cutoff_px);

struct WantedBlock {
  std::uint64_t block = 0;
  float priority = 0.0F;  ///< the highest of its nodes'
  friend bool operator==(const WantedBlock&, const WantedBlock&) = default;
};

/// Calls body(i) for each i in [0, count), in any order, on as many threads as it likes, and returns when all are done.
using ForEach = std::function<void(std::size_t count, const std::function<void(std::size_t)>& body)>;

struct TraverseRequest {
  base::Camera camera;     ///< perspective, off-axis too, or parallel; its width and height give pixels their size
  float cutoff_px = 1.0F;  ///< largest projected diameter of an inner node that is drawn; 0: only leaves
  bool cull = true;        ///< what is outside the frustum is left out
  /// What turns its back is left out: right for closed surfaces. Open ones may be seen from behind.
  bool cull_back_faces = true;
  /// What lies wholly beyond it is left out. With a section, back faces are drawn, as one sees into the model.
  glm::vec4 section = base::kNoSection;
  std::optional<Lens> lens;  ///< through it nodes are refined to cutoffThroughLens(cutoff_px)
  Priority priority;         ///< empty: sweepPriority
  ForEach for_each;          ///< empty: one after the other. The result does not depend on it.
};

struct Traversal {
  std::vector<Splat> splats;
  std::vector<WantedBlock> wanted;  ///< each once, highest priority first; equals by number
  std::uint64_t nodes = 0;          ///< decoded
  std::uint64_t outside = 0;        ///< of them, left out: outside of the frustum or beyond the section
  std::uint64_t facing_away = 0;    ///< … turned away
  /// The file contradicts itself: a code is none, a pointer leads back or beyond it or is missing, there are more nodes
  /// than its header says, or more than 128 levels. What was come upon until then is drawn.
  bool damaged = false;
};

/// Time: about 20 ns a node and core once its block is in memory. Without block 1 nothing is drawn. `result`: replaced;
/// its memory is used again, so keep it from frame to frame.
void traverse(Blocks& blocks, const TraverseRequest& request, Traversal& result);
Traversal traverse(Blocks& blocks, const TraverseRequest& request);

/// Projected diameter in pixels, as the cut-off means it: across the direction from the picture's middle, where
/// perspective does not stretch a sphere.
float projectedDiameter(const glm::vec3& center, float radius, const base::Camera& camera);

}  // namespace lod::qsplat
