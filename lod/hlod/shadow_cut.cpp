#include "lod/hlod/shadow_cut.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>

#include "lod/hlod/light_view.h"
#include "lod/hlod/seen_box.h"
#include "lod/view_box.h"

namespace lod::hlod {

float casterError(const ShadowLight& light, float receiver, float change, float to_light, float to_receiver) {
  const double penumbra = static_cast<double>(change) * static_cast<double>(light.size);
  const auto d_l = static_cast<double>(to_light), d_p = static_cast<double>(to_receiver);
  const auto error = static_cast<double>(receiver);
  if (light.place.w == 0.0F) return static_cast<float>(error + penumbra * d_p);
  if (!(d_l + d_p > 0.0)) return receiver;
  return static_cast<float>((error * d_l + penumbra * d_p) / (d_l + d_p));
}

namespace {

/// Receivers that share maps: those of one level of the octree, or of several, or what of them lies in a slice of the
/// view.
struct Group {
  std::vector<std::uint32_t> members;  ///< places in the list of receivers
  SeenBox box;
  double nearest = std::numeric_limits<double>::infinity();    ///< largest z of the slice
  double farthest = -std::numeric_limits<double>::infinity();  ///< its least z
};

/// A map before its casters are known.
struct Map {
  LightView view;
  std::vector<std::uint32_t> receivers;
  SeenBox box;                               ///< of these receivers, and the room around them
  double scale = 0.0;                        ///< the most pixels of the view that a scene unit of them covers
  double pixels = 0.0;                       ///< the same of a unit of the light's picture
  double texel = 0.0;                        ///< wanted size: scene units, or those of a picture at depth 1
  bool has_all = true;                       ///< each of its group's views from the light has a map
  bool ends_near = false, ends_far = false;  ///< others show what lies nearer to the eye, or farther from it
  double texels() const { return view.size().x / texel * (view.size().y / texel); }
};

/// A group and its maps.
struct Shared {
  Group group;
  std::vector<Map> maps;
};

std::size_t countMaps(const std::vector<Shared>& shared) {
  return std::accumulate(shared.begin(), shared.end(), std::size_t{0},
                         [](std::size_t sum, const Shared& some) { return sum + some.maps.size(); });
}

/// The most pixels that a unit of the light's picture covers. `scale`: that a unit of the scene covers.
double pixelsIn(const LightView& view, const BoxCorners& corners, double scale) {
  return view.isParallel() ? scale : scale * view.largestDepth(corners);
}

/// The ends of the octree's levels, which lie behind one another.
std::vector<std::uint32_t> levelEnds(std::span<const Node> nodes) {
  std::vector<std::uint32_t> ends{1};
  for (std::uint32_t begin = 0;;) {
    std::uint32_t last = ends.back();
    while (last > begin && nodes[last - 1].isLeaf()) --last;
    if (last == begin) return ends;
    begin = ends.back();
    ends.push_back(nodes[last - 1].first_child + nodes[last - 1].children);
  }
}

class Planner {
 public:
  Planner(std::span<const Node> nodes, std::span<const ShadowReceiver> receivers, const ShadowRequest& request)
      : nodes_(nodes), receivers_(receivers), request_(request), space_(request.view) {}

  /// Maps by groups of receivers.
  std::vector<std::vector<Map>> run();
  double coarseness(const Map& map) const;
  ShadowMapPlan finish(const Map& map) const;

 private:
  bool isFinite() const;
  void findReceivers();
  void addRoom(SeenBox& box) const;
  void addSlice(const Map& map, ShadowMapPlan& plan) const;
  std::vector<Group> groupByLevel() const;
  std::vector<Map> mapsOf(const Group& group) const;
  std::optional<Map> mapOf(const Group& group, const LightView& view) const;
  std::vector<Shared> shareMaps(std::vector<Group> groups) const;
  SeenBox partOf(const Group& group, std::uint32_t member) const;
  Group slice(const Group& group, double nearest, double farthest) const;
  void sliceCoarse(std::vector<Shared>& shared) const;
  glm::ivec2 sizeOf(const Map& map) const;
  double coarseness(const Shared& shared) const;

  const std::span<const Node> nodes_;
  const std::span<const ShadowReceiver> receivers_;
  const ShadowRequest& request_;
  const SeenSpace space_;
  std::vector<SeenBox> seen_;  // of each receiver
  double coordinate_ = 0.0;    // the largest of the scene, either sign
};

bool Planner::isFinite() const {
  const glm::dvec3 place(request_.light.place);
  const bool is_light = std::isfinite(glm::length(place)) && std::isfinite(request_.light.size) &&
                        (request_.light.place.w != 0.0F || glm::length(place) > 0.0);
  return is_light && space_.isFinite() && request_.view.tolerance > 0.0F && request_.texel_px > 0.0F;
}

void Planner::findReceivers() {
  for (const ShadowReceiver& receiver : receivers_) seen_.push_back(space_.seenPart(receiver.box));
  const glm::vec3 largest = glm::max(glm::abs(nodes_[0].box.min), glm::abs(nodes_[0].box.max));
  coordinate_ = static_cast<double>(std::max({largest.x, largest.y, largest.z, 1e-20F}));
}

/// From the coarsest level on; levels without receivers that are seen are left out.
std::vector<Group> Planner::groupByLevel() const {
  std::map<std::uint32_t, Group> by_level;
  for (std::uint32_t i = 0; i < receivers_.size(); ++i) {
    if (seen_[i].empty()) continue;
    Group& group = by_level[receivers_[i].level];
    group.members.push_back(i);
    group.box.add(seen_[i]);
  }
  std::vector<Group> groups;
  for (auto& [level, group] : by_level) groups.push_back(std::move(group));
  return groups;
}

/// The room ends with the scene.
void Planner::addRoom(SeenBox& box) const {
  if (!(request_.room > 0.0F)) return;
  SeenBox scene;
  for (const glm::dvec3& corner : boxCorners(nodes_[0].box)) scene.add(space_.toEye(corner));
  const glm::dvec3 room = static_cast<double>(request_.room) * (box.max - box.min);
  box.min = glm::min(box.min, glm::max(box.min - room, scene.min));
  box.max = glm::max(box.max, glm::min(box.max + room, scene.max));
}

std::vector<Map> Planner::mapsOf(const Group& group) const {
  std::vector<Map> maps;
  SeenBox box = group.box;
  addRoom(box);
  std::vector<LightView> views = viewsFrom(request_.light, box, space_);
  for (LightView& view : views) {
    view.widen(coordinate_);
    if (auto map = mapOf(group, view)) maps.push_back(std::move(*map));
  }
  for (Map& map : maps) map.has_all = maps.size() == views.size();
  return maps;
}

std::optional<Map> Planner::mapOf(const Group& group, const LightView& view) const {
  Map map{view, {}, {}};
  for (const std::uint32_t member : group.members) {
    const SeenBox part = partOf(group, member);
    const BoxCorners corners = space_.toScene(part);
    if (!view.mayHold(corners)) continue;
    const double scale = space_.largestScale(part);
    map.receivers.push_back(member);
    map.box.add(part);
    map.scale = std::max(map.scale, scale);
    map.pixels = std::max(map.pixels, pixelsIn(view, corners, scale));
  }
  if (map.receivers.empty()) return std::nullopt;
  std::sort(map.receivers.begin(), map.receivers.end());
  addRoom(map.box);
  map.ends_near = std::isfinite(group.nearest), map.ends_far = std::isfinite(group.farthest);
  const double nearer = 1.0 + static_cast<double>(request_.room);
  map.scale *= nearer, map.pixels *= nearer;
  map.texel = static_cast<double>(request_.texel_px) / map.pixels;
  return map;
}

double texelsOf(const std::vector<Map>& maps) {
  return std::accumulate(maps.begin(), maps.end(), 0.0, [](double sum, const Map& map) { return sum + map.texels(); });
}

/// Merges neighbouring levels, those first whose common maps take the fewest texels more, until there are few maps.
std::vector<Shared> Planner::shareMaps(std::vector<Group> groups) const {
  std::vector<Shared> shared;
  for (Group& group : groups) {
    std::vector<Map> maps = mapsOf(group);
    shared.push_back({std::move(group), std::move(maps)});
  }
  const auto merged = [&](std::size_t i) {
    const Group& next = shared[i + 1].group;
    Group both = shared[i].group;
    both.members.insert(both.members.end(), next.members.begin(), next.members.end());
    both.box.add(next.box);
    return both;
  };
  while (shared.size() > 1 && countMaps(shared) > request_.max_maps) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i + 1 < shared.size(); ++i) {
      const double growth = texelsOf(mapsOf(merged(i))) - texelsOf(shared[i].maps) - texelsOf(shared[i + 1].maps);
      if (growth < least) least = growth, best = i;
    }
    shared[best].group = merged(best);
    shared[best].maps = mapsOf(shared[best].group);
    shared.erase(shared.begin() + static_cast<std::ptrdiff_t>(best) + 1);
  }
  return shared;
}

/// The part of a receiver that lies in the group's slice.
SeenBox Planner::partOf(const Group& group, std::uint32_t member) const {
  SeenBox part = seen_[member];
  if (part.max.z <= group.nearest && part.min.z >= group.farthest) return part;
  part.max.z = std::min(part.max.z, group.nearest);
  part.min.z = std::max(part.min.z, group.farthest);
  return space_.betweenSides(part);
}

Group Planner::slice(const Group& group, double nearest, double farthest) const {
  Group part;
  part.nearest = nearest, part.farthest = farthest;
  for (const std::uint32_t member : group.members) {
    const SeenBox box = partOf(part, member);
    if (box.empty()) continue;
    part.members.push_back(member);
    part.box.add(box);
  }
  return part;
}

/// Divides by distance from the eye what has texels over four times as large as wanted, as long as there may be more
/// maps. A ground up to the horizon is near the eye in its nearest part alone. Slices follow one another from the eye
/// on.
void Planner::sliceCoarse(std::vector<Shared>& shared) const {
  constexpr double kCoarse = 4.0;
  while (!shared.empty()) {
    const auto worst = std::max_element(shared.begin(), shared.end(), [this](const Shared& a, const Shared& b) {
      return coarseness(a) < coarseness(b);
    });
    const double before = coarseness(*worst);
    if (before <= kCoarse) return;
    const Group& group = worst->group;
    const double near_z = group.box.max.z, far_z = group.box.min.z;
    const double middle = space_.isParallel() || near_z >= 0.0 ? 0.5 * (near_z + far_z) : -std::sqrt(near_z * far_z);
    Shared near{slice(group, group.nearest, middle), {}}, far{slice(group, middle, group.farthest), {}};
    if (near.group.members.empty() || far.group.members.empty()) return;
    near.maps = mapsOf(near.group), far.maps = mapsOf(far.group);
    const bool has_room =
        countMaps(shared) - worst->maps.size() + near.maps.size() + far.maps.size() <= request_.max_maps;
    if (!has_room || coarseness(near) >= before || coarseness(far) >= before) return;
    *worst = std::move(near);
    shared.insert(worst + 1, std::move(far));
  }
}

/// How many times larger texels are than wanted.
double Planner::coarseness(const Map& map) const {
  const glm::dvec2 texel = map.view.size() / glm::dvec2(sizeOf(map));
  return std::max(texel.x, texel.y) / map.texel;
}

double Planner::coarseness(const Shared& shared) const {
  double most = 0.0;
  for (const Map& map : shared.maps) most = std::max(most, coarseness(map));
  return most;
}

glm::ivec2 Planner::sizeOf(const Map& map) const {
  const auto most = static_cast<double>(std::clamp<std::uint32_t>(request_.max_texels, 1, 1U << 30));
  glm::ivec2 texels;
  for (int axis = 0; axis < 2; ++axis)
    texels[axis] = static_cast<int>(std::clamp(std::ceil(map.view.size()[axis] / map.texel), 1.0, most));
  return texels;
}

/// Chooses the casters of a map.
class CasterChoice {
 public:
  CasterChoice(const ShadowRequest& request, const SeenSpace& space, const Map& map, float receiver_error)
      : request_(request),
        space_(space),
        box_(map.box),
        receiver_error_(receiver_error),
        planes_(map.view.casterPlanes(request.light)) {
    for (const glm::dvec3& corner : space.toScene(map.box)) {
      bounds_.add(glm::vec3(corner));
      farthest_ = std::max(farthest_, static_cast<float>(glm::length(corner - glm::dvec3(request.light.place))));
    }
  }

  /// Rising.
  std::vector<std::uint32_t> choose(std::span<const Node> nodes) const;

 private:
  bool mayCast(const base::Aabb& box) const;
  float distanceTo(const base::Aabb& node) const;
  float allowedError(const base::Aabb& node) const;

  const ShadowRequest& request_;
  const SeenSpace& space_;
  const SeenBox box_;      // of the receivers
  base::Aabb bounds_;      // around it, scene-local
  float farthest_ = 0.0F;  // of its places from a light that is at a place
  const float receiver_error_;
  const std::array<glm::dvec4, 5> planes_;
};

std::vector<std::uint32_t> CasterChoice::choose(std::span<const Node> nodes) const {
  std::vector<std::uint32_t> casters;
  std::vector<std::uint32_t> open{0};
  while (!open.empty()) {
    const std::uint32_t number = open.back();
    const Node& node = nodes[number];
    open.pop_back();
    if (!mayCast(node.box)) continue;
    if (node.isLeaf() || node.caster_error <= allowedError(node.box)) {
      casters.push_back(number);
      continue;
    }
    for (std::uint32_t child = node.first_child; child < node.first_child + node.children; ++child)
      open.push_back(child);
  }
  std::sort(casters.begin(), casters.end());
  return casters;
}

/// Whether a part of the box may lie between the light and the receivers.
bool CasterChoice::mayCast(const base::Aabb& box) const {
  if (isBeyond(request_.view.camera.section, box)) return false;
  return std::all_of(planes_.begin(), planes_.end(), [&](const glm::dvec4& plane) {
    const glm::dvec3 corner(plane.x >= 0.0 ? box.max.x : box.min.x, plane.y >= 0.0 ? box.max.y : box.min.y,
                            plane.z >= 0.0 ? box.max.z : box.min.z);
    return glm::dot(glm::dvec3(plane), corner) + plane.w >= 0.0;
  });
}

/// At most the distance of the node's box from the receivers', 0 where they overlap: the larger of what the axes of the
/// scene and those of the view tell.
float CasterChoice::distanceTo(const base::Aabb& node) const {
  SeenBox seen;
  for (const glm::dvec3& corner : boxCorners(node)) seen.add(space_.toEye(corner));
  const auto gap = [](const auto& a, const auto& b) {
    const glm::dvec3 above(a.min - b.max), below(b.min - a.max);
    return glm::length(glm::max(glm::max(above, below), glm::dvec3(0.0)));
  };
  return static_cast<float>(std::max(gap(bounds_, node), gap(box_, seen)));
}

float CasterChoice::allowedError(const base::Aabb& node) const {
  const ShadowLight& light = request_.light;
  const float nearest = distanceTo(node), change = request_.intensity_change;
  if (light.place.w == 0.0F) return casterError(light, receiver_error_, change, 0.0F, nearest);
  const glm::vec3 place(light.place);
  const float least = glm::length(glm::clamp(place, node.min, node.max) - place);
  const float most = glm::length(glm::max(glm::abs(node.min - place), glm::abs(node.max - place)));
  // The formula is linear in d_l / (d_l + d_p), so it is least at one of both ends.
  return std::min(casterError(light, receiver_error_, change, most, nearest),
                  casterError(light, receiver_error_, change, least, std::max(farthest_ - least, nearest)));
}

/// Slices overlap by what is lost to rounding.
void Planner::addSlice(const Map& map, ShadowMapPlan& plan) const {
  const glm::dvec3 backwards = space_.axes()[2];
  const double zero = space_.toEye(glm::dvec3(0.0)).z;
  const double rounding = 1e-6 * coordinate_ + 1e-5 * (map.box.max.z - map.box.min.z);
  if (map.ends_near) plan.slice[0] = {-backwards, map.box.max.z - zero + rounding};
  if (map.ends_far) plan.slice[1] = {backwards, zero - map.box.min.z + rounding};
}

ShadowMapPlan Planner::finish(const Map& map) const {
  ShadowMapPlan plan;
  plan.receivers = map.receivers;
  plan.receiver_error = static_cast<float>(static_cast<double>(request_.view.tolerance) / map.scale);
  plan.casters = CasterChoice(request_, space_, map, plan.receiver_error).choose(nodes_);
  for (const glm::dvec3& corner : space_.toScene(map.box)) plan.region.add(glm::vec3(corner));
  addSlice(map, plan);
  plan.region.min = glm::max(plan.region.min, nodes_[0].box.min);
  plan.region.max = glm::min(plan.region.max, nodes_[0].box.max);

  double near_depth = map.view.nearDepth();
  for (const std::uint32_t caster : plan.casters)
    near_depth = std::min(near_depth, map.view.leastDepth(nodes_[caster].box));
  plan.camera = map.view.camera(near_depth, sizeOf(map));
  plan.texel_px = static_cast<float>(static_cast<double>(request_.texel_px) * coarseness(map));
  return plan;
}

std::vector<std::vector<Map>> Planner::run() {
  if (nodes_.empty() || receivers_.empty() || !isFinite()) return {};
  findReceivers();
  std::vector<Shared> shared = shareMaps(groupByLevel());
  sliceCoarse(shared);
  std::vector<std::vector<Map>> maps;
  for (Shared& some : shared) maps.push_back(std::move(some.maps));
  return maps;
}

}  // namespace

std::vector<ShadowReceiver> receiversOf(std::span<const Node> nodes, std::span<const std::uint32_t> drawn) {
  std::vector<ShadowReceiver> receivers;
  if (nodes.empty()) return receivers;
  const std::vector<std::uint32_t> ends = levelEnds(nodes);
  for (const std::uint32_t node : drawn) {
    const auto level = std::upper_bound(ends.begin(), ends.end(), node) - ends.begin();
    receivers.push_back({nodes[node].box, static_cast<std::uint32_t>(level)});
  }
  return receivers;
}

std::vector<ShadowMapPlan> planShadowMaps(std::span<const Node> nodes, std::span<const ShadowReceiver> receivers,
                                          const ShadowRequest& request) {
  Planner planner(nodes, receivers, request);
  std::vector<ShadowMapPlan> plans;
  for (const std::vector<Map>& maps : planner.run())
    for (const Map& map : maps) plans.push_back(planner.finish(map));
  return plans;
}

double largestScale(const TraverseRequest& view, const base::Aabb& box) {
  const SeenSpace space(view);
  const SeenBox seen = space.seenPart(box);
  return seen.empty() ? 0.0 : space.largestScale(seen);
}

namespace {

/// A parallel view that just shows the box.
base::Camera cameraAround(const base::Aabb& box, double pixels_per_unit) {
  const glm::dvec3 low(box.min), high(box.max), middle = 0.5 * (low + high);
  const glm::dvec3 half = glm::max(0.5 * (high - low), glm::dvec3(1e-6 * glm::length(high - low)));
  const glm::dvec2 pixels = glm::ceil(glm::dvec2(2.0 * half) * pixels_per_unit);
  base::Camera camera;
  camera.width = static_cast<int>(std::clamp(pixels.x, 1.0, 1e9));
  camera.height = static_cast<int>(std::clamp(pixels.y, 1.0, 1e9));
  // The height is whole pixels, so that they have the size that was asked for.
  const double half_height = 0.5 * camera.height / pixels_per_unit;
  camera.clip_from_eye[0][0] = static_cast<float>(1.0 / half.x);
  camera.clip_from_eye[1][1] = static_cast<float>(1.0 / std::max(half_height, half.y));
  camera.clip_from_eye[2][2] = static_cast<float>(-1.0 / half.z);
  camera.eye_from_scene[3] = glm::vec4(-glm::vec3(middle), 1.0F);
  return camera;
}

}  // namespace

std::optional<ShadowMapPlan> planSceneShadowMap(std::span<const Node> nodes, double pixels_per_unit,
                                                const ShadowRequest& request) {
  if (nodes.empty() || !(pixels_per_unit > 0.0)) return std::nullopt;
  ShadowRequest whole = request;
  whole.view.camera = cameraAround(nodes[0].box, pixels_per_unit);
  whole.view.tile.reset();
  whole.max_maps = 1;
  whole.room = 0.0F;
  std::vector<ShadowMapPlan> plans = planShadowMaps(nodes, std::vector<ShadowReceiver>{{nodes[0].box, 0}}, whole);
  constexpr float kTexelRounding = 1.001F;
  if (plans.size() != 1 || plans[0].texel_px > kTexelRounding * request.texel_px) return std::nullopt;
  plans[0].receivers.clear();
  return std::move(plans[0]);
}

// ---- Plans that hold for several views

/// The last plans, and what they were made for.
struct ShadowPlanner::Kept {
  ShadowRequest request;
  std::vector<std::vector<Map>> groups;
  std::vector<ShadowMapPlan> plans;  // those of the groups' maps, one after the other

  bool isFor(const ShadowRequest& other) const;
  bool takeReceivers(std::span<const ShadowReceiver> receivers, const TraverseRequest& view);

 private:
  struct Place;
  bool serves(const std::vector<Map>& maps, const Place& place) const;
  bool take(const Place& place);
};

ShadowPlanner::ShadowPlanner() = default;
ShadowPlanner::~ShadowPlanner() = default;

/// Whether the requests ask for the same but for the view's camera.
bool ShadowPlanner::Kept::isFor(const ShadowRequest& other) const {
  return request.light == other.light && request.view.camera.section == other.view.camera.section &&
         request.view.tolerance == other.view.tolerance && request.intensity_change == other.intensity_change &&
         request.texel_px == other.texel_px && request.max_texels == other.max_texels &&
         request.max_maps == other.max_maps && request.room == other.room;
}

/// The part of a receiver that is seen.
struct ShadowPlanner::Kept::Place {
  std::uint32_t receiver;
  const SeenSpace& now;   // of the view
  const SeenSpace& then;  // of that for which the plans were made
  SeenBox seen_now, seen_then;

  Place(std::uint32_t number, const base::Aabb& box, const SeenSpace& space_now, const SeenSpace& space_then)
      : receiver(number), now(space_now), then(space_then), seen_now(now.seenPart(box)) {
    if (seen_now.empty()) return;
    SeenBox all;  // corners of what is seen may lie beyond those of the receiver, and of the scene
    for (const glm::dvec3& corner : boxCorners(box)) all.add(then.toEye(corner));
    for (const glm::dvec3& corner : now.toScene(seen_now)) seen_then.add(then.toEye(corner));
    seen_then = seen_then.within(all);
  }
  /// The part of it that lies in a range of depths of the former view.
  SeenBox inSlice(const SeenBox& slice) const {
    SeenBox part = seen_then;
    part.min.z = std::max(part.min.z, slice.min.z), part.max.z = std::min(part.max.z, slice.max.z);
    return part;
  }
  /// The most pixels that a scene unit of the part covers in the view.
  double scaleOf(const SeenBox& part) const {
    SeenBox seen;
    for (const glm::dvec3& corner : then.toScene(part)) seen.add(now.toEye(corner));
    seen = seen.within(seen_now);
    return now.largestScale(seen.empty() ? seen_now : seen);
  }
};

/// Whether the maps' room holds all of the place that lies as far from the eye as they do, and they are fine enough.
bool ShadowPlanner::Kept::serves(const std::vector<Map>& maps, const Place& place) const {
  bool is_held = false;
  for (const Map& map : maps) {
    const SeenBox part = place.inSlice(map.box);
    if (part.empty()) continue;
    const BoxCorners corners = place.then.toScene(part);
    if (!map.view.mayHold(corners)) continue;
    const double scale = place.scaleOf(part);
    if (!map.has_all || !map.box.contains(part.min) || !map.box.contains(part.max) || scale > map.scale ||
        pixelsIn(map.view, corners, scale) > map.pixels)
      return false;
    is_held = true;
  }
  return is_held;
}

/// Puts a receiver into the plans of the coarsest maps that hold all of it, or of slices that hold it together. Returns
/// false where none do.
bool ShadowPlanner::Kept::take(const Place& place) {
  std::vector<std::size_t> serving;
  std::optional<std::size_t> whole;
  double reached = place.seen_then.max.z;  // slices hold it from the eye to there
  std::size_t first_plan = 0;
  std::vector<std::size_t> first_plans;
  for (std::size_t g = 0; g < groups.size(); first_plan += groups[g].size(), ++g) {
    first_plans.push_back(first_plan);
    if (groups[g].empty() || !serves(groups[g], place)) continue;
    SeenBox box;
    for (const Map& map : groups[g]) box.add(map.box);
    const bool holds_all = box.max.z >= place.seen_then.max.z && box.min.z <= place.seen_then.min.z;
    if (holds_all && (!whole || groups[g].front().scale < groups[*whole].front().scale)) whole = g;
    if (box.max.z >= reached && box.min.z < reached) serving.push_back(g), reached = box.min.z;
  }
  if (whole) serving = {*whole};
  if (!whole && reached > place.seen_then.min.z) return false;
  for (const std::size_t g : serving)
    for (std::size_t m = 0; m < groups[g].size(); ++m) {
      const SeenBox part = place.inSlice(groups[g][m].box);
      if (part.empty() || !groups[g][m].view.mayHold(place.then.toScene(part))) continue;
      plans[first_plans[g] + m].receivers.push_back(place.receiver);
    }
  return true;
}

/// Puts receivers into the plans. Returns false where a receiver is served by none of them, or where all need maps half
/// as fine at most, which cost less to draw.
bool ShadowPlanner::Kept::takeReceivers(std::span<const ShadowReceiver> receivers, const TraverseRequest& view) {
  const SeenSpace now(view), then(request.view);
  if (!now.isFinite()) return false;
  for (ShadowMapPlan& plan : plans) plan.receivers.clear();
  double needed = 0.0, finest = 0.0;
  for (std::uint32_t i = 0; i < receivers.size(); ++i) {
    const Place place(i, receivers[i].box, now, then);
    if (place.seen_now.empty()) continue;
    if (!take(place)) return false;
    needed = std::max(needed, now.largestScale(place.seen_now));
  }
  for (const std::vector<Map>& maps : groups)
    for (const Map& map : maps) finest = std::max(finest, map.scale);
  return 2.0 * needed > finest;
}

std::vector<ShadowMapPlan> ShadowPlanner::plan(std::span<const Node> nodes, std::span<const ShadowReceiver> receivers,
                                               const ShadowRequest& request) {
  if (kept_ && kept_->isFor(request) && kept_->takeReceivers(receivers, request.view)) return kept_->plans;
  kept_ = std::make_unique<Kept>(Kept{request, {}, {}});
  ShadowRequest fewer = request;
  for (fewer.max_maps = 1;; ++fewer.max_maps) {
    Planner planner(nodes, receivers, fewer);
    kept_->groups = planner.run();
    // Each map draws casters anew, so that more than a few are worth it for very coarse ones alone.
    constexpr std::size_t kFewMaps = 4;
    const double most = fewer.max_maps < kFewMaps ? 2.0 : 4.0;
    const auto isFine = [&](const Map& map) { return planner.coarseness(map) <= most; };
    const bool are_fine = std::all_of(kept_->groups.begin(), kept_->groups.end(), [&](const std::vector<Map>& maps) {
      return std::all_of(maps.begin(), maps.end(), isFine);
    });
    if (!are_fine && fewer.max_maps < request.max_maps) continue;
    for (const std::vector<Map>& maps : kept_->groups)
      for (const Map& map : maps) kept_->plans.push_back(planner.finish(map));
    return kept_->plans;
  }
}

}  // namespace lod::hlod
