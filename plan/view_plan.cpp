#include "plan/view_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "lod/patch/traverse.h"
#include "plan/point_choice.h"

namespace plan {
namespace {

/// The share of later views' gain that counts where patches are all that there is; and while the eye moves fast, where
/// later views have images, too, which leave less to gain. Choices (docs/decisions/gain-per-byte.md).
constexpr float kLaterAlone = 0.3F, kLaterUnderImages = 0.05F;

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
  query.sight_cache = scene.sight_cache;
  query.eye = local.request.camera.eye;
  query.section = local.request.camera.section;
  query.pixels_per_unit_at_one = local.request.camera.pixelsPerUnitAtOne();
  query.error_px = std::max(1.0F, view.patch_tolerance_px);
  query.max_points = std::min<std::size_t>(view.max_points, kMaxPointsPerView);
  return query;
}

bool wantsImages(const Scene& scene, const protocol::View& view) {
  return scene.images && scene.welcome->grid.pointCount() != 0 && view.max_points != 0;
}

/// The patch of a group's finer side that most likely holds a place: the one whose box is nearest, and of those that
/// hold it the one whose middle is nearest for its size.
std::uint32_t patchAt(const lod::patch::Hierarchy& hierarchy, const lod::patch::Group& group, const glm::vec3& place) {
  std::uint32_t nearest = group.first_patch;
  float least = std::numeric_limits<float>::max();
  for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
    const lod::patch::Patch& patch = hierarchy.patches[p];
    const glm::vec3 outside = place - glm::clamp(place, patch.box.min, patch.box.max);
    const glm::vec3 away = place - patch.bounds.center;
    const float size2 = patch.bounds.radius * patch.bounds.radius + 1e-30F;
    const float apart = glm::dot(outside, outside) / size2 + 1e-3F * glm::dot(away, away) / size2;
    if (apart < least) least = apart, nearest = p;
  }
  return nearest;
}

ProxyShading shadingOf(const lod::patch::Hierarchy& hierarchy, const lod::patch::Patch& patch) {
  if (patch.producer == lod::patch::kNoGroup) return {lod::patch::colorDetailOf(patch), 0.0F};
  if (!hierarchy.isKnown(patch.producer)) {
    // A patch is about as large as a square whose diagonal is its sphere's; half of one edge's square is a triangle.
    const float edge = 2.0F * patch.bounds.radius / std::sqrt(std::max(1.0F, static_cast<float>(patch.triangles)));
    return {lod::patch::typicalColorErrorOf(patch, std::max(edge, 1e-30F)), patch.own_typical_error};
  }
  const lod::patch::Group& group = hierarchy.groups[patch.producer];
  return {group.typical_color_error, group.typical_error};
}

/// The groups of a view's cut that the viewer lacks.
struct GroupsToSend {
  static constexpr std::size_t kNotExpanded = SIZE_MAX, kHeld = SIZE_MAX - 1;
  std::vector<std::uint32_t> numbers;
  std::vector<OrderedGroup> groups;  // beside `numbers`
  std::vector<std::size_t> place;    // of each group of the hierarchy: an index into `numbers`, or one of the above
};

/// All but the parents.
OrderedGroup describe(const lod::patch::Hierarchy& hierarchy, std::uint32_t number,
                      const lod::patch::CutRequest& request) {
  const lod::patch::Group& group = hierarchy.groups[number];
  OrderedGroup ordered;
  ordered.bytes = std::max<std::uint64_t>(1, group.block_bytes);
  if (number == 0) return ordered;  // it comes first whatever it gains
  ordered.before = {group.typical_color_error, group.typical_error};
  for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
    const ProxyShading finer = shadingOf(hierarchy, hierarchy.patches[p]);
    ordered.after.color_error += finer.color_error / static_cast<float>(group.patch_count);
    ordered.after.shape_error += finer.shape_error / static_cast<float>(group.patch_count);
  }
  const float distance = std::max(glm::length(group.bounds.center - request.camera.eye), group.bounds.radius);
  ordered.density = request.camera.pixelsPerUnitAtOne() / distance;
  const float radius_px = group.bounds.radius * ordered.density;
  const float pixels = static_cast<float>(request.camera.width) * static_cast<float>(request.camera.height);
  ordered.share = std::min(1.0F, std::numbers::pi_v<float> * radius_px * radius_px / pixels);
  return ordered;
}

/// `images`: the view has some, which bring colours, too.
GroupsToSend groupsToSend(const Scene& scene, const LocalView& local, bool images, const HasGroup& is_here) {
  GroupsToSend send;
  const bool brings_colors = images && local.request.measure == base::ErrorMeasure::kVisible;
  std::vector<bool> is_needed(scene.hierarchy->groups.size(), !brings_colors);
  if (brings_colors) {
    lod::patch::CutRequest of_shape = local.request;
    of_shape.measure = base::ErrorMeasure::kShape;
    for (const std::uint32_t group : lod::patch::selectCut(*scene.hierarchy, of_shape).expanded)
      is_needed[group] = true;
  }
  send.place.assign(scene.hierarchy->groups.size(), GroupsToSend::kNotExpanded);
  for (const std::uint32_t group : local.cut.expanded) {
    send.place[group] = GroupsToSend::kHeld;
    if (is_here(group)) continue;
    OrderedGroup ordered = describe(*scene.hierarchy, group, local.request);
    ordered.is_needed = is_needed[group];
    for (const std::uint32_t parent : scene.hierarchy->parentsOf(group))
      if (send.place[parent] < GroupsToSend::kHeld) ordered.parents.push_back(send.place[parent]);
    send.place[group] = send.numbers.size();
    send.numbers.push_back(group);
    send.groups.push_back(std::move(ordered));
  }
  return send;
}

/// How the proxy shows a place, from the root down to the cut.
ProxyPlace proxyAt(const lod::patch::Hierarchy& hierarchy, const GroupsToSend& send, const glm::vec3& place) {
  // Without any patch all is missing.
  const float size = hierarchy.groups[0].bounds.radius;
  ProxyPlace proxy{{1.0F, size}, {}, 1.0F};
  for (std::uint32_t group = 0; send.place[group] != GroupsToSend::kNotExpanded;) {
    const lod::patch::Patch& patch = hierarchy.patches[patchAt(hierarchy, hierarchy.groups[group], place)];
    const ProxyShading shading = shadingOf(hierarchy, patch);
    if (shading.color_error > 0.0F) proxy.detail = std::min(proxy.detail, shading.color_error);
    if (send.place[group] == GroupsToSend::kHeld)
      proxy.now = shading;
    else
      proxy.refined.push_back({send.place[group], shading});
    if (patch.producer == lod::patch::kNoGroup || !hierarchy.isKnown(patch.producer)) break;
    group = patch.producer;
  }
  return proxy;
}

std::vector<SurfaceSample> surfaceIn(const Scene& scene, const LocalView& local, int columns, int rows) {
  return scene.sight != nullptr
             ? sampleVisibleSurface(*scene.sight, local.request.camera, columns, rows)
             : sampleVisibleSurface(*scene.hierarchy, local.cut.patches, local.request.camera, columns, rows);
}

/// The places from which points and faces are chosen.
std::vector<SurfaceSample> surfaceOf(const Scene& scene, const LocalView& local) {
  return surfaceIn(scene, local, kSurfaceColumns / scene.ray_step, kSurfaceRows / scene.ray_step);
}

OrderByGain orderItems(const Scene& scene, const LocalView& local, const PointQuery& query,
                       std::span<const glm::uvec3> points, const GroupsToSend& send, const HasFace& is_here) {
  // A tile that shows a fifteenth of the picture's width is met by a ray.
  constexpr int kColumns = 24;
  constexpr int kRows = 14;
  const auto samples = surfaceIn(scene, local, kColumns / scene.ray_step, kRows / scene.ray_step);
  std::vector<ProxyPlace> places;
  places.reserve(samples.size());
  for (const SurfaceSample& sample : samples) places.push_back(proxyAt(*scene.hierarchy, send, sample.position));
  const std::size_t per_point = query.grid.isTiled() ? kTilesPerPoint : kFacesPerPoint;
  GainQuery gain{query, std::max(query.grid.isTiled() ? kMinTiles : kMinFaces, per_point * query.max_points)};
  // Shadows change colours by about a tenth in the root mean square. A choice.
  if (scene.welcome->shadows) gain.lacking2 = 0.01F;
  gain.image_bytes = scene.image_bytes.typical(query.grid);
  gain.is_here = is_here;
  gain.later_share = points.empty() ? kLaterAlone : scene.is_fast ? kLaterUnderImages : 0.0F;
  gain.stored_bytes = scene.stored_bytes;
  gain.counts_foreground = scene.rests;
  // Rays miss much of what a link with room to spare brings to an eye that moves, or has just come.
  gain.leaves_groups = scene.rests || scene.link_rate < kFastLink;
  return orderByGain(gain, points, samples, places, send.groups);
}

/// Plain faces that the view shows, and of which nothing tells what they gain, come after all else.
void appendOtherFaces(const Scene& scene, const LocalView& local, const PointQuery& query,
                      std::span<const glm::uvec3> points, const HasFace& is_here,
                      std::vector<repository::FaceKey>& faces) {
  const std::size_t most = std::max(kMinFaces, kFacesPerPoint * query.max_points);
  std::size_t count = faces.size();  // with those that are there
  for (const repository::FaceKey& key : orderFaces(query, points, surfaceOf(scene, local))) {
    if (std::find(faces.begin(), faces.end(), key) != faces.end()) continue;
    if (++count > most) return;
    if (!is_here(key)) faces.push_back(key);
  }
}

std::vector<glm::uvec3> pointsFor(const Scene& scene, const LocalView& local, const PointQuery& query) {
  return choosePoints(query, surfaceOf(scene, local));
}

/// Whether all patches are soon here.
bool bringsItsColorsSoon(const Scene& scene) {
  return scene.patch_bytes != 0 && static_cast<double>(scene.patch_bytes) <= kSoonWhole * scene.link_rate;
}

/// Takes groups and faces of the view into the plan.
void planItems(const Scene& scene, const LocalView& local, const PointQuery& query, std::span<const glm::uvec3> points,
               const Holdings& present, ViewPlan& plan) {
  const GroupsToSend send = groupsToSend(scene, local, !points.empty(), present.group);
  const OrderByGain order = orderItems(scene, local, query, points, send, present.face);
  plan.error_before = order.error_before;
  plan.error_after = order.error_after;
  for (const OrderedItem& item : order.items) {
    if (item.image) {
      plan.faces.push_back(*item.image);
      plan.face_gains.push_back(item.gain);
    } else {
      plan.groups.push_back(send.numbers[item.group]);
      plan.is_needed.push_back(send.groups[item.group].is_needed);
      plan.faces_before.push_back(plan.faces.size());
    }
  }
  if (!query.grid.isTiled() && !points.empty()) appendOtherFaces(scene, local, query, points, present.face, plan.faces);
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

}  // namespace

std::uint64_t ImageBytes::typical(const repository::Grid& grid) const {
  constexpr double kBytesPerPixel = 0.075, kBytesPerTile = 8'000.0;
  constexpr std::uint64_t kGuessCounts = 4;
  const double side = static_cast<double>(grid.face_size);
  const auto guess = static_cast<std::uint64_t>(grid.isTiled() ? kBytesPerTile : kBytesPerPixel * side * side);
  return std::max<std::uint64_t>(1, (kGuessCounts * guess + sum_) / (kGuessCounts + count_));
}

bool isMoving(const protocol::Welcome& welcome, const protocol::View& newest, const protocol::View& previous) {
  constexpr double kLongestStep = 0.1, kWidestTurn = 0.9;  // of the scene's diagonal; a cosine
  const double step = glm::length(newest.camera.position - previous.camera.position);
  const double turn = glm::dot(newest.camera.direction, previous.camera.direction);
  const bool is_same = step == 0.0 && newest.camera.direction == previous.camera.direction;
  return !is_same && turn > kWidestTurn &&
         step < kLongestStep * static_cast<double>(glm::length(welcome.box_max - welcome.box_min));
}

bool isFast(const base::ViewCamera& from, const base::ViewCamera& to, double seconds, double diagonal) {
  constexpr double kTurn = 0.4, kStep = 0.33;  // radians, and of the diagonal, a second: choices
  if (seconds <= 0.0) return false;
  return glm::length(to.position - from.position) > kStep * diagonal * seconds ||
         glm::dot(to.direction, from.direction) < std::cos(kTurn * seconds);
}

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

protocol::View viewToPlan(const Scene& scene, const protocol::View& view) {
  protocol::View planned = view;
  const bool brings_colors = wantsImages(scene, view) && view.measure == base::ErrorMeasure::kVisible;
  if (brings_colors && scene.is_fresh && scene.link_rate < kFastLink && !bringsItsColorsSoon(scene))
    planned.measure = base::ErrorMeasure::kShape;
  return planned;
}

ViewPlan planView(const Scene& scene, const protocol::View& wanted, const Holdings& present) {
  const protocol::View view = viewToPlan(scene, wanted);
  const LocalView local = cutForView(scene, view);
  const PointQuery query = queryFor(scene, view, local);
  std::vector<glm::uvec3> points;
  if (wantsImages(scene, view)) points = pointsFor(scene, local, query);
  ViewPlan plan;
  planItems(scene, local, query, points, present, plan);
  plan.points = points;
  for (const glm::uvec3& p : points) {
    for (const repository::FaceKey& key : othersOf(scene.welcome->grid, p)) {
      const bool in_view = std::find(plan.faces.begin(), plan.faces.end(), key) != plan.faces.end();
      if (!in_view && !present.face(key)) plan.other_faces.push_back(key);
    }
  }
  return plan;
}

std::vector<repository::FaceKey> planMotion(const Scene& scene, const protocol::View& newest,
                                            const protocol::View& previous, const Holdings& present) {
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
  return planView(scene, next, present).faces;
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
