#pragma once
// Chooses for a view which leaves of the octree are seen, and the level of each (Dey and Hudson 2002, section 3).
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "lod/pmr/format.h"

namespace lod::pmr {

struct TraverseRequest {
  base::Camera camera;     ///< perspective, off-axis too, or parallel; its width and height give pixels their size
  float tolerance = 1.0F;  ///< umbrellas of the chosen level have about this many pixels; above 0
  bool cull = true;        ///< leaves outside the frustum are skipped
  /// Where a part of the picture is drawn: that part's camera, whose frustum culls in place of `camera`'s.
  std::optional<base::Camera> tile = std::nullopt;
};

struct ChosenLeaf {
  std::uint32_t leaf = 0;
  std::uint32_t level = 0;
  float pixel = 0.0F;     ///< pixelSizeAt() the leaf's box (figure 5)
  float priority = 0.0F;  ///< larger ones are fetched first: the leaf's extent in pixels
};

/// The size of a pixel where the box is nearest to the eye, scene units: the least of what a picture shows of the box,
/// so no detail is left out. It counts by distance along the viewing direction, at least to the near plane.
float pixelSizeAt(const base::Camera& camera, const base::Aabb& box);
/// The level whose mean umbrella radius is nearest to tolerance × pixel by ratio. The tolerance fades to 1 between
/// pixels of 2 and 4 times the radius at level 0, if it is above 1 ("Results": sparse levels are used where they do not
/// show).
std::uint32_t levelFor(const Leaf& leaf, float pixel, float tolerance);

/// The octree above the leaves, for culling.
class Octree {
 public:
  explicit Octree(std::span<const Leaf> leaves);
  /// Finds the leaves that may be seen, by falling priority. `result` is replaced.
  void choose(std::span<const Leaf> leaves, const TraverseRequest& request, std::vector<ChosenLeaf>& result) const;

 private:
  struct Node {
    base::Aabb box;
    std::uint32_t first = 0, end = 0;  // leaves
    std::uint32_t skip = 0;            // the node behind its subtree; nodes lie in depth-first order
  };
  std::vector<Node> nodes_;
};

}  // namespace lod::pmr
