#include "plan/view_plan.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "lod/patch/traverse.h"
#include "plan/point_choice.h"

namespace plan {
namespace {

/// A view in scene-local coordinates, with the cut at which the client should arrive.
struct LocalView {
  lod::patch::CutRequest request;
  lod::patch::Cut cut;
};

LocalView cutForView(const Scene& scene, const protocol::View& view) {
  LocalView local;
  local.request = cutRequestFor(*scene.welcome, view);
  local.cut = lod::patch::selectCut(*scene.hierarchy, local.request);
  return local;
}

PointQuery queryFor(const Scene& scene, const protocol::View& view, const LocalView& local) {
  PointQuery query;
  query.grid = scene.welcome->grid;
  query.tree = scene.sample_tree;
  query.sight = scene.sight;
  query.eye = local.request.camera.eye;
  query.pixels_per_unit_at_one = local.request.camera.pixelsPerUnitAtOne();
  query.error_px = std::max(1.0F, view.patch_tolerance_px);
  query.max_points = std::min<std::size_t>(view.max_points, kMaxPointsPerView);
  return query;
}

bool wantsImages(const Scene& scene, const protocol::View& view) {
  return scene.images && scene.welcome->grid.pointCount() != 0 && view.max_points != 0;
}

/// The sampling points that the view needs, and their faces that it needs.
struct PointsAndFaces {
  std::vector<glm::uvec3> points;
  std::vector<repository::FaceKey> faces;
};

PointsAndFaces chooseFaces(const Scene& scene, const protocol::View& view, const LocalView& local) {
  const PointQuery query = queryFor(scene, view, local);
  const auto samples = scene.sight != nullptr
                           ? sampleVisibleSurface(*scene.sight, local.request.camera)
                           : sampleVisibleSurface(*scene.hierarchy, local.cut.patches, local.request.camera);
  PointsAndFaces choice;
  choice.points = choosePoints(query, samples);
  choice.faces = orderFaces(query, choice.points, samples);
  choice.faces.resize(std::min(choice.faces.size(), std::max(kMinFaces, kFacesPerPoint * query.max_points)));
  return choice;
}

void planGroups(const Scene& scene, const LocalView& local, ViewPlan& plan) {
  plan.groups = local.cut.expanded;
  plan.group_error_px.reserve(plan.groups.size());
  for (std::uint32_t group : plan.groups) {
    const lod::patch::Group& g = scene.hierarchy->groups[group];
    plan.group_error_px.push_back(base::projectedError(
        lod::patch::errorOf(g, local.request.measure), g.bounds.center, g.bounds.radius, local.request.camera.eye,
        local.request.camera.pixelsPerUnitAtOne(), local.request.near_plane));
  }
}

}  // namespace

lod::patch::CutRequest cutRequestFor(const protocol::Welcome& welcome, const protocol::View& view) {
  const base::Sphere scene{0.5F * (welcome.box_min + welcome.box_max),
                           0.5F * glm::length(welcome.box_max - welcome.box_min)};
  lod::patch::CutRequest request;
  request.camera = base::cameraForScene(view.camera, welcome.origin, scene);
  request.near_plane = base::nearestDistance(request.camera.eye, scene);
  request.tolerance_px = view.patch_tolerance_px;
  request.measure = view.measure;
  request.max_triangles = view.max_triangles;
  return request;
}

bool isUrgent(float error_px, const protocol::View& view) {
  return error_px > kUrgentErrorRatio * std::max(1.0F, view.patch_tolerance_px);
}

ViewPlan planView(const Scene& scene, const protocol::View& view, const HasFace& present) {
  const LocalView local = cutForView(scene, view);
  ViewPlan plan;
  planGroups(scene, local, plan);
  if (!wantsImages(scene, view)) return plan;

  PointsAndFaces choice = chooseFaces(scene, view, local);
  for (const glm::uvec3& p : choice.points) {
    for (std::uint32_t d = 0; d < 6; ++d) {
      const repository::FaceKey key{p.x, p.y, p.z, d};
      const bool in_view = std::find(choice.faces.begin(), choice.faces.end(), key) != choice.faces.end();
      if (!in_view && !present(key)) plan.other_faces.push_back(key);
    }
  }
  plan.faces = std::move(choice.faces);
  std::erase_if(plan.faces, present);
  return plan;
}

std::vector<repository::FaceKey> planMotion(const Scene& scene, const protocol::View& newest,
                                            const protocol::View& previous, const HasFace& present) {
  if (!wantsImages(scene, newest)) return {};
  // The eye repeats its last step and its last turn.
  const glm::dvec3 step = newest.camera.position - previous.camera.position;
  const glm::dvec3 turn = newest.camera.direction - previous.camera.direction;
  if (glm::length(step) == 0.0 && glm::length(turn) == 0.0) return {};
  protocol::View next = newest;
  next.camera.position += step;
  const glm::dvec3 direction = newest.camera.direction + turn;
  if (glm::length(direction) > 1e-6) next.camera.direction = glm::normalize(direction);
  if (glm::length(glm::cross(next.camera.direction, next.camera.up)) < 1e-6) return {};

  std::vector<repository::FaceKey> faces = chooseFaces(scene, next, cutForView(scene, next)).faces;
  std::erase_if(faces, present);
  return faces;
}

std::vector<std::uint32_t> coarseGroups(const lod::patch::Hierarchy& hierarchy, std::uint64_t bytes) {
  constexpr std::size_t kMaxGroups = 4096;  // more than fit into any coarse model: a block has tens of bytes at least
  std::vector<std::uint32_t> order(hierarchy.groups.size());
  std::iota(order.begin(), order.end(), 0U);
  // Errors are monotone and parents have smaller numbers, so this order puts parents first.
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(std::min(kMaxGroups, order.size()));
  std::partial_sort(order.begin(), end, order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const float error_a = hierarchy.groups[a].visible_error;
    const float error_b = hierarchy.groups[b].visible_error;
    return error_a != error_b ? error_a > error_b : a < b;
  });

  std::vector<std::uint32_t> coarse;
  std::uint64_t sum = 0;
  for (auto group = order.begin(); group != end; ++group) {
    sum += hierarchy.groups[*group].block_bytes;
    if (sum > bytes && !coarse.empty()) break;
    coarse.push_back(*group);
  }
  return coarse;
}

}  // namespace plan
