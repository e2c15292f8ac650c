#include "lod/hlod/traverse.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "lod/view_box.h"

namespace lod::hlod {
namespace {

constexpr float kInfinite = std::numeric_limits<float>::infinity();

/// Cones are tested for an eye so many radii of its box away in a parallel view: rays are then parallel within 1e-4
/// radian, and float32 still tells the radii apart.
constexpr float kFarAway = 1e4F;

/// The largest pixels per unit of length that a view shows of the box. A step of length l from a place at the distance
/// d and the depth z moves in the picture by l · d / z² at most, in units of the picture at depth 1: obliquely seen
/// places move more than those straight ahead.
float largestScale(const base::Camera& camera, const base::Aabb& box) {
  const float scale = camera.pixelsPerUnitAtOne();
  if (camera.orthographic()) return scale;
  const float distance = glm::length(glm::clamp(camera.eye, box.min, box.max) - camera.eye);
  float least_depth = kInfinite, largest_secant = 0.0F;
  const glm::mat4 clip = camera.clipFromScene();
  for (int i = 0; i < 8; ++i) {
    const float depth = (clip * glm::vec4(box.corner(i), 1.0F)).w;
    least_depth = std::min(least_depth, depth);
    largest_secant =
        std::max(largest_secant, depth > 0.0F ? glm::length(box.corner(i) - camera.eye) / depth : kInfinite);
  }
  // The part of the box that is seen lies within the picture's corners, and the ratio is largest at a box's corner.
  largest_secant = std::min(largest_secant, 1.0F / cornerCosine(camera));
  const float depth = std::max(least_depth, distance / largest_secant);
  return depth > 0.0F ? scale * largest_secant / depth : kInfinite;
}

base::Sphere sphereAround(const base::Aabb& box) {
  return {box.center(), 0.5001F * box.diagonal()};
}

}  // namespace

float projectedError(const base::Camera& camera, const base::Aabb& box, float error) {
  if (!(error > 0.0F)) return 0.0F;
  const float pixels = error * largestScale(camera, box);
  return std::isnan(pixels) ? kInfinite : pixels;
}

Sight::Sight(const TraverseRequest& request)
    : request_(request), frustum_(request.tile.value_or(request.camera).clipFromScene()) {}

bool Sight::maySee(const Node& node) const {
  if (request_.cull && !frustum_.mayOverlap(node.box)) return false;
  if (isBeyond(request_.camera.section, node.box)) return false;
  if (!request_.cull_back_faces) return true;
  const base::Sphere bounds = sphereAround(node.box);
  const base::Camera& camera = request_.camera;
  const glm::vec3 eye = camera.orthographic()
                            ? bounds.center + kFarAway * bounds.radius * camera.towardsViewer(bounds.center)
                            : camera.eye;
  return !base::facesAway(node.cone, bounds, eye);
}

std::vector<std::uint32_t> chooseCut(std::span<const Node> nodes, const TraverseRequest& request) {
  const Sight sight(request);
  std::vector<std::pair<float, std::uint32_t>> cut;
  std::vector<std::uint32_t> open;
  if (!nodes.empty() && sight.maySee(nodes[0])) open.push_back(0);
  while (!open.empty()) {
    const std::uint32_t number = open.back();
    const Node& node = nodes[number];
    open.pop_back();
    if (node.isLeaf() || projectedError(request.camera, node.box, node.error) <= request.tolerance) {
      cut.emplace_back(depthOf(request.camera, node.box), number);
      continue;
    }
    for (std::uint32_t child = node.first_child; child < node.first_child + node.children; ++child)
      if (sight.maySee(nodes[child])) open.push_back(child);
  }
  std::sort(cut.begin(), cut.end());
  std::vector<std::uint32_t> chosen;
  chosen.reserve(cut.size());
  for (const auto& [depth, number] : cut) chosen.push_back(number);
  return chosen;
}

}  // namespace lod::hlod
