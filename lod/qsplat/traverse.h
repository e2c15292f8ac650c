#pragma once
// Finds the splats to draw for a view (Rusinkiewicz and Levoy 2000, section 2.1), and the blocks that would make the
// picture finer (Rusinkiewicz and Levoy 2001, sections 3.2 and 4.2).
//
// A node is drawn without its children where its sphere's projected diameter is at most the cut-off, where it is a
// leaf, or where the block of its children is missing. Any other node that may be seen is replaced by its children. At
// any cut-off, whatever is missing, the spheres that are drawn contain all of the surface that faces the viewer within
// the frustum, so kernels that cover their sphere's projection leave no hole.
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "base/camera.h"
#include "lod/qsplat/blocks.h"
#include "lod/qsplat/splat.h"

namespace lod::qsplat {

/// A node that would be refined, but whose children's block is missing.
struct MissingChildren {
  std::uint64_t block = 0;  ///< the block of the children
  std::uint32_t level = 0;  ///< level of the node; the root is at 0
  float radius = 0.0F;      ///< radius of the node, scene units
  float size_px = 0.0F;     ///< projected diameter of the node; infinite where its centre lies behind the eye
  /// Projection of the node's centre, pixels from the picture's upper left corner. It may lie outside, and is undefined
  /// where size_px is infinite.
  glm::vec2 at_px{0.0F};
};

/// A block's priority: larger ones are fetched first. Called from several threads at a time if `for_each` is set.
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
/// Whether a sphere is at least partly seen through the lens. `at_px`, `size_px`: as in MissingChildren.
bool isSeenThrough(const Lens& lens, const glm::vec2& at_px, float size_px);
/// The cut-off for nodes seen through a lens, if the others have `cutoff_px`: a third of it, but no less than half a
/// pixel, below which no difference shows.
float cutoffThroughLens(float cutoff_px);

struct WantedBlock {
  std::uint64_t block = 0;
  float priority = 0.0F;  ///< the highest one of its nodes
  friend bool operator==(const WantedBlock&, const WantedBlock&) = default;
};

/// Calls body(i) for each i in [0, count), in any order, on as many threads as it likes, and returns when all are done.
using ForEach = std::function<void(std::size_t count, const std::function<void(std::size_t)>& body)>;

struct TraverseRequest {
  base::Camera camera;     ///< perspective, off-axis too, or parallel; its width and height give pixels their size
  float cutoff_px = 1.0F;  ///< largest projected diameter of an inner node that is drawn; 0: only leaves
  bool cull = true;        ///< nodes outside the frustum are skipped
  /// Nodes that face away are skipped. Right for closed surfaces; open ones may be seen from behind. Where the camera
  /// has a section they are kept, since one sees into the model.
  bool cull_back_faces = true;
  std::optional<Lens> lens;  ///< through it nodes are refined to cutoffThroughLens(cutoff_px)
  Priority priority;         ///< empty: sweepPriority
  ForEach for_each;          ///< empty: sequential; the result is the same
};

struct Traversal {
  std::vector<Splat> splats;
  std::vector<WantedBlock> wanted;  ///< each once, by falling priority, then by number
  std::uint64_t nodes = 0;          ///< decoded
  std::uint64_t outside = 0;        ///< nodes skipped outside the frustum or beyond the section
  std::uint64_t facing_away = 0;    ///< nodes skipped since they face away
  /// The file contradicts itself: an invalid code, a pointer that is missing or leads back or beyond the file, more
  /// nodes than its header says, or more than 128 levels. The splats found until then are valid.
  bool damaged = false;
};

/// Takes about 20 ns a node and core once its block is in memory. Finds nothing without block 1. `result` is replaced,
/// and its memory is reused: keep it from frame to frame.
void traverse(Blocks& blocks, const TraverseRequest& request, Traversal& result);
Traversal traverse(Blocks& blocks, const TraverseRequest& request);

}  // namespace lod::qsplat
