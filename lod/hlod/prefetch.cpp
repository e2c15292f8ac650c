#include "lod/hlod/prefetch.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lod/view_box.h"

namespace lod::hlod {
namespace {

/// How far a view must turn, or step aside, until it shows a part of the box: 0 where its frustum does now. At most the
/// true motion: boxes count as spheres, and the picture's corners as reached from everywhere.
float motionToSee(const base::Camera& camera, const base::Frustum& frustum, const base::Aabb& box) {
  if (frustum.mayOverlap(box)) return 0.0F;
  const glm::vec3 center = box.center();
  const float radius = 0.5F * box.diagonal(), distance = glm::length(center - camera.eye);
  const float height = 2.0F / camera.clip_from_eye[1][1];
  const bool is_parallel = camera.orthographic();
  if (!is_parallel && distance <= radius) return 0.0F;
  const auto arcsine = [](float sine) { return std::asin(std::clamp(sine, -1.0F, 1.0F)); };
  float motion = 0.0F;
  for (std::size_t side = 0; side < 4; ++side) {
    const glm::vec4& plane = frustum.planes[side];
    const float outside = -(glm::dot(glm::vec3(plane), center) + plane.w);
    motion = std::max(
        motion, is_parallel ? (outside - radius) / height : arcsine(outside / distance) - arcsine(radius / distance));
  }
  if (is_parallel) return motion;
  // The sides tell no more than a right angle.
  const float ahead = arcsine(depthOf(camera, box) / distance);
  const float corner = arcsine(cornerCosine(camera));
  return std::max(motion, corner - ahead - arcsine(radius / distance));
}

class Finder {
 public:
  Finder(std::span<const Node> nodes, const TraverseRequest& request)
      : nodes_(nodes),
        request_(request),
        camera_(request.tile.value_or(request.camera)),
        frustum_(camera_.clipFromScene()),
        turned_sight_(turned(request)) {}

  std::vector<NextNode> run() {
    std::vector<std::uint32_t> open{0};
    while (!open.empty()) {
      const std::uint32_t number = open.back();
      const Node& node = nodes_[number];
      open.pop_back();
      if (!turned_sight_.maySee(node)) continue;
      const float error_px = projectedError(request_.camera, node.box, node.error);
      if (node.isLeaf() || error_px <= request_.tolerance) {
        addFinal(number, error_px);
        continue;
      }
      for (std::uint32_t child = node.first_child; child < node.first_child + node.children; ++child)
        open.push_back(child);
    }
    return std::move(found_);
  }

 private:
  /// The request of a view that may have turned anywhere.
  static TraverseRequest turned(TraverseRequest request) {
    request.cull = request.cull_back_faces = false;
    return request;
  }

  /// A node as fine as the view draws nodes.
  void addFinal(std::uint32_t number, float error_px) {
    const Node& node = nodes_[number];
    if (!frustum_.mayOverlap(node.box)) found_.push_back({motionToSee(camera_, frustum_, node.box), number});
    // The error grows as the distance falls, and passes the tolerance after this part of it.
    const float step = 1.0F - error_px / request_.tolerance;
    for (std::uint32_t child = node.first_child; child < node.first_child + node.children; ++child)
      if (turned_sight_.maySee(nodes_[child]))
        found_.push_back({step + motionToSee(camera_, frustum_, nodes_[child].box), child});
  }

  const std::span<const Node> nodes_;
  const TraverseRequest& request_;
  const base::Camera camera_;
  const base::Frustum frustum_;
  const Sight turned_sight_;
  std::vector<NextNode> found_;
};

/// Sorts by motion, and keeps the first ones that have so many bytes together. `bytesOf`: those of a node.
template <class BytesOf>
std::vector<NextNode> firstByMotion(std::vector<NextNode> found, std::uint64_t max_bytes, const BytesOf& bytesOf) {
  std::sort(found.begin(), found.end(), [](const NextNode& a, const NextNode& b) {
    return a.motion != b.motion ? a.motion < b.motion : a.node < b.node;
  });
  std::uint64_t bytes = 0;
  const auto end = std::find_if(found.begin(), found.end(), [&](const NextNode& next) {
    bytes += bytesOf(next.node);
    return bytes > max_bytes;
  });
  found.erase(end, found.end());
  return found;
}

}  // namespace

std::vector<NextNode> nodesWantedNext(std::span<const Node> nodes, const TraverseRequest& request,
                                      std::uint64_t max_bytes) {
  if (nodes.empty()) return {};
  return firstByMotion(Finder(nodes, request).run(), max_bytes,
                       [&](std::uint32_t node) { return nodes[node].picture.bytes; });
}

std::vector<NextNode> castersWantedNext(std::span<const Node> nodes, const LightRequest& request,
                                        std::uint64_t max_bytes) {
  std::vector<NextNode> found;
  if (nodes.empty() || !(request.max_error > 0.0F)) return found;
  const base::Frustum frustum(request.camera.clipFromScene());
  const auto motionTo = [&](std::uint32_t node) { return motionToSee(request.camera, frustum, nodes[node].box); };
  // The far plane lies behind all receivers, and nothing there casts a shadow on them.
  const glm::vec4& far_plane = frustum.planes[5];
  const auto isBehind = [&](const base::Aabb& box) {
    const glm::vec3 corner = glm::mix(box.min, box.max, glm::greaterThanEqual(glm::vec3(far_plane), glm::vec3(0.0F)));
    return glm::dot(far_plane, glm::vec4(corner, 1.0F)) < 0.0F;
  };
  std::vector<std::uint32_t> open{0};
  while (!open.empty()) {
    const std::uint32_t number = open.back();
    const Node& node = nodes[number];
    open.pop_back();
    if (isBehind(node.box)) continue;
    const bool is_final = node.isLeaf() || node.caster_error <= request.max_error;
    if (is_final && !frustum.mayOverlap(node.box)) found.push_back({motionTo(number), number});
    // Children of a final one are wanted where the allowed error falls to its error.
    const float step = is_final ? 1.0F - node.caster_error / request.max_error : 0.0F;
    for (std::uint32_t child = node.first_child; child < node.first_child + node.children; ++child) {
      if (is_final)
        found.push_back({step + motionTo(child), child});
      else
        open.push_back(child);
    }
  }
  return firstByMotion(std::move(found), max_bytes, [&](std::uint32_t node) {
    return nodes[node].isLeaf() ? nodes[node].picture.bytes : nodes[node].caster.bytes;
  });
}

bool isSameRequest(const TraverseRequest& a, const TraverseRequest& b) {
  const bool same_tile = a.tile.has_value() == b.tile.has_value() && (!a.tile || base::sameCamera(*a.tile, *b.tile));
  return base::sameCamera(a.camera, b.camera) && same_tile && a.tolerance == b.tolerance && a.cull == b.cull &&
         a.cull_back_faces == b.cull_back_faces;
}

}  // namespace lod::hlod
