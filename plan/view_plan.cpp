#include "plan/view_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "lod/patch/traverse.h"
#include "plan/point_choice.h"
#include "plan/tile_choice.h"

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

/// The patch of the cut that most likely holds a place: the one nearest for its size.
const lod::patch::Patch* patchAt(const Scene& scene, const lod::patch::Cut& cut, const glm::vec3& place) {
  const lod::patch::Patch* nearest = nullptr;
  float least = std::numeric_limits<float>::max();
  for (const std::uint32_t number : cut.patches) {
    const lod::patch::Patch& patch = scene.hierarchy->patches[number];
    const glm::vec3 away = place - patch.bounds.center;
    const float apart = glm::dot(away, away) / (patch.bounds.radius * patch.bounds.radius + 1e-30F);
    if (apart < least) least = apart, nearest = &patch;
  }
  return nearest;
}

ProxyShading shadingOf(const lod::patch::Hierarchy& hierarchy, const lod::patch::Patch& patch) {
  // A patch is about as large as a square whose diagonal is its sphere's; half of one edge's square is a triangle.
  const float edge = 2.0F * patch.bounds.radius / std::sqrt(std::max(1.0F, static_cast<float>(patch.triangles)));
  if (patch.producer == lod::patch::kNoGroup) return {0.0F, edge, 0.0F};
  if (!hierarchy.isKnown(patch.producer))
    return {lod::patch::typicalColorErrorOf(patch, std::max(edge, 1e-30F)), edge, patch.own_typical_error};
  const lod::patch::Group& group = hierarchy.groups[patch.producer];
  return {group.typical_color_error, edge, group.typical_error};
}

std::vector<SurfaceSample> surfaceIn(const Scene& scene, const LocalView& local, int columns, int rows) {
  return scene.sight != nullptr
             ? sampleVisibleSurface(*scene.sight, local.request.camera, columns, rows)
             : sampleVisibleSurface(*scene.hierarchy, local.cut.patches, local.request.camera, columns, rows);
}

std::vector<repository::FaceKey> chooseTiles(const Scene& scene, const LocalView& local, const PointQuery& query,
                                             std::span<const glm::uvec3> points, const HasFace& present) {
  // A tile that shows a fifteenth of the picture's width is met by a ray.
  constexpr int kColumns = 24;
  constexpr int kRows = 14;
  const auto samples = surfaceIn(scene, local, kColumns, kRows);
  std::vector<ProxyShading> proxies;
  for (const SurfaceSample& sample : samples) {
    const lod::patch::Patch* patch = patchAt(scene, local.cut, sample.position);
    proxies.push_back(patch != nullptr ? shadingOf(*scene.hierarchy, *patch) : ProxyShading());
  }
  TileQuery tiles{query, std::max(kMinTiles, kTilesPerPoint * query.max_points)};
  tiles.is_here = present;
  if (scene.is_absent) tiles.is_absent = scene.is_absent;
  std::vector<repository::FaceKey> keys;
  for (const ChosenTile& chosen : plan::chooseTiles(tiles, points, samples, proxies)) keys.push_back(chosen.key);
  return keys;
}

/// The sampling points that the view needs, and their faces that it needs.
struct PointsAndFaces {
  std::vector<glm::uvec3> points;
  std::vector<repository::FaceKey> faces;
};

PointsAndFaces chooseFaces(const Scene& scene, const protocol::View& view, const LocalView& local,
                           const HasFace& present) {
  const PointQuery query = queryFor(scene, view, local);
  const auto samples = surfaceIn(scene, local, kSurfaceColumns, kSurfaceRows);
  PointsAndFaces choice;
  choice.points = choosePoints(query, samples);
  if (query.grid.isTiled()) {
    choice.faces = chooseTiles(scene, local, query, choice.points, present);
    return choice;
  }
  choice.faces = orderFaces(query, choice.points, samples);
  choice.faces.resize(std::min(choice.faces.size(), std::max(kMinFaces, kFacesPerPoint * query.max_points)));
  return choice;
}

/// The faces of a point, or their coarsest tiles of which all together are about as many bytes.
std::vector<repository::FaceKey> othersOf(const repository::Grid& grid, const glm::uvec3& point) {
  constexpr std::uint32_t kCoarseDepth = 1;
  const std::uint32_t tiles = grid.isTiled() ? repository::firstTileOf(kCoarseDepth + 1) : 1;
  std::vector<repository::FaceKey> keys;
  for (std::uint32_t tile = 0; tile < tiles; ++tile)
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back({point.x, point.y, point.z, d, tile});
  return keys;
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

  PointsAndFaces choice = chooseFaces(scene, view, local, present);
  for (const glm::uvec3& p : choice.points) {
    for (const repository::FaceKey& key : othersOf(scene.welcome->grid, p)) {
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

  std::vector<repository::FaceKey> faces = chooseFaces(scene, next, cutForView(scene, next), present).faces;
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
