#include "lod/hlod/shadow_cut.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
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

/// Receivers that share maps: those of one level of the octree, or of several.
struct Group {
  std::vector<std::uint32_t> members;  ///< places in the list of receivers
  SeenBox box;
};

/// A map before its casters are known.
struct Map {
  LightView view;
  std::vector<std::uint32_t> receivers;
  SeenBox box;         ///< of these receivers
  double scale = 0.0;  ///< the most pixels of the view that a scene unit of them covers
  double texel = 0.0;  ///< wanted size: scene units, or those of a picture at depth 1
  double texels() const { return view.size().x / texel * (view.size().y / texel); }
};

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

  std::vector<ShadowMapPlan> run();

 private:
  bool isFinite() const;
  void findReceivers();
  std::vector<Group> groupByLevel() const;
  std::vector<Map> mapsOf(const Group& group) const;
  std::optional<Map> mapOf(const Group& group, const LightView& view) const;
  std::vector<std::vector<Map>> shareMaps(std::vector<Group> groups) const;
  glm::ivec2 sizeOf(const Map& map) const;
  ShadowMapPlan finish(const Map& map) const;

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

std::vector<Map> Planner::mapsOf(const Group& group) const {
  std::vector<Map> maps;
  for (LightView view : viewsFrom(request_.light, group.box, space_)) {
    view.widen(coordinate_);
    if (auto map = mapOf(group, view)) maps.push_back(std::move(*map));
  }
  return maps;
}

std::optional<Map> Planner::mapOf(const Group& group, const LightView& view) const {
  Map map{view, {}, {}};
  double pixels = 0.0;  // that a unit of the light's picture covers
  for (const std::uint32_t member : group.members) {
    const BoxCorners corners = space_.toScene(seen_[member]);
    if (!view.mayHold(corners)) continue;
    const double scale = space_.largestScale(seen_[member]);
    map.receivers.push_back(member);
    map.box.add(seen_[member]);
    map.scale = std::max(map.scale, scale);
    pixels = std::max(pixels, view.isParallel() ? scale : scale * view.largestDepth(corners));
  }
  if (map.receivers.empty()) return std::nullopt;
  std::sort(map.receivers.begin(), map.receivers.end());
  map.texel = static_cast<double>(request_.texel_px) / pixels;
  return map;
}

double texelsOf(const std::vector<Map>& maps) {
  return std::accumulate(maps.begin(), maps.end(), 0.0, [](double sum, const Map& map) { return sum + map.texels(); });
}

/// Merges neighbouring levels, those first whose common maps take the fewest texels more, until there are few maps.
std::vector<std::vector<Map>> Planner::shareMaps(std::vector<Group> groups) const {
  std::vector<std::vector<Map>> maps;
  for (const Group& group : groups) maps.push_back(mapsOf(group));
  const auto merged = [&](std::size_t i) {
    Group both = groups[i];
    both.members.insert(both.members.end(), groups[i + 1].members.begin(), groups[i + 1].members.end());
    both.box.add(groups[i + 1].box);
    return both;
  };
  const auto count = [&] {
    return std::accumulate(maps.begin(), maps.end(), std::size_t{0},
                           [](std::size_t sum, const auto& some) { return sum + some.size(); });
  };
  while (groups.size() > 1 && count() > request_.max_maps) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i + 1 < groups.size(); ++i) {
      const double growth = texelsOf(mapsOf(merged(i))) - texelsOf(maps[i]) - texelsOf(maps[i + 1]);
      if (growth < least) least = growth, best = i;
    }
    const auto next = static_cast<std::ptrdiff_t>(best) + 1;
    groups[best] = merged(best);
    maps[best] = mapsOf(groups[best]);
    groups.erase(groups.begin() + next);
    maps.erase(maps.begin() + next);
  }
  return maps;
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
  if (glm::vec3(request_.view.section) != glm::vec3(0.0F) && isBeyond(request_.view.section, box)) return false;
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

ShadowMapPlan Planner::finish(const Map& map) const {
  ShadowMapPlan plan;
  plan.receivers = map.receivers;
  plan.receiver_error = static_cast<float>(static_cast<double>(request_.view.tolerance) / map.scale);
  plan.casters = CasterChoice(request_, space_, map, plan.receiver_error).choose(nodes_);

  double near_depth = map.view.nearDepth();
  for (const std::uint32_t caster : plan.casters)
    near_depth = std::min(near_depth, map.view.leastDepth(nodes_[caster].box));
  const glm::ivec2 texels = sizeOf(map);
  plan.camera = map.view.camera(near_depth, texels);
  const glm::dvec2 texel = map.view.size() / glm::dvec2(texels);
  plan.texel_px = static_cast<float>(static_cast<double>(request_.texel_px) * std::max(texel.x, texel.y) / map.texel);
  return plan;
}

std::vector<ShadowMapPlan> Planner::run() {
  std::vector<ShadowMapPlan> plans;
  if (nodes_.empty() || receivers_.empty() || !isFinite()) return plans;
  findReceivers();
  for (const std::vector<Map>& maps : shareMaps(groupByLevel()))
    for (const Map& map : maps) plans.push_back(finish(map));
  return plans;
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
  return Planner(nodes, receivers, request).run();
}

}  // namespace lod::hlod
