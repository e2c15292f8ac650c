#pragma once
// The projected error of a node, by which cuts are chosen (Guthe et al. 2004, section 4).
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "lod/hlod/format.h"

namespace lod::hlod {

struct TraverseRequest {
  base::Camera camera;     ///< perspective, off-axis too, or parallel; its width and height give pixels their size
  float tolerance = 0.5F;  ///< the most that a node's error may be on the screen, pixels; above 0
  bool cull = true;        ///< nodes outside the frustum are skipped
  /// Nodes of which every triangle faces away are skipped, too: for closed surfaces alone.
  bool cull_back_faces = false;
  /// Where a part of the picture is drawn: that part's camera, whose frustum culls in place of `camera`'s.
  std::optional<base::Camera> tile = std::nullopt;
};

/// The error in pixels where the box is nearest to the eye, so that no place of it shows a larger one; infinite for an
/// eye in the box unless the error is 0.
float projectedError(const base::Camera& camera, const base::Aabb& box, float error);

/// Whether a node may be seen in the view.
class Sight {
 public:
  explicit Sight(const TraverseRequest& request);
  bool maySee(const Node& node) const;

 private:
  const TraverseRequest request_;
  const base::Frustum frustum_;
};

/// The cut of a file that is here whole: the nodes to draw, nearest first.
std::vector<std::uint32_t> chooseCut(std::span<const Node> nodes, const TraverseRequest& request);

}  // namespace lod::hlod
