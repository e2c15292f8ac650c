#include "lod/patch/traverse.h"

#include <algorithm>
#include <cmath>
#include <queue>

#include "lod/view_box.h"

namespace lod::patch {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

struct GroupProgress {
  std::uint32_t expanded_parents = 0;
  std::uint32_t last_parent = kNoGroup;  ///< so that a parent with several of our patches counts once
  std::uint32_t visible_triangles = 0;   ///< triangles of the patches it produced, as far as they are in the cut
  bool expanded = false;
};

struct Candidate {
  float error_px = 0.0F;
  std::uint32_t group = 0;

  // Heap order: the largest error on top, then the smallest number, so that the same view gives the same cut.
  bool operator<(const Candidate& other) const {
    return error_px != other.error_px ? error_px < other.error_px : group > other.group;
  }
};

class CutSelection {
 public:
  CutSelection(const Hierarchy& hierarchy, const CutRequest& request,
               const std::function<bool(std::uint32_t)>& available)
      : hierarchy_(hierarchy),
        request_(request),
        available_(available),
        frustum_(request.camera.clipFromScene()),
        states_(hierarchy.groups.size()) {}

  Cut run() {
    if (states_.empty() || !hierarchy_.isKnown(0)) return {};
    refine();
    collectPatches();
    sortWanted();
    return std::move(cut_);
  }

 private:
  // Refines top down, always where the projected error is largest.
  void refine() {
    heap_.push({kInfinity, 0});
    while (!heap_.empty()) {
      const Candidate next = heap_.top();
      heap_.pop();
      const std::uint64_t finer = measureConsumed(next.group);
      const std::uint64_t coarser = states_[next.group].visible_triangles;
      const std::uint64_t cost = costOfConsumed(next.group);
      if (next.group != 0 &&
          (cut_.triangles - coarser + finer > request_.max_triangles || cut_.cost + cost > request_.max_cost)) {
        cut_.limited = true;
        return;
      }
      if (available_ && !available_(next.group)) {
        wanted_.push_back(next);
      } else {
        cut_.triangles = cut_.triangles - coarser + finer;
        cut_.cost += cost;
        expand(next.group);
      }
    }
  }

  // Finds the visible ones among the patches that the group consumes (visible_), and sums their triangles.
  std::uint64_t measureConsumed(std::uint32_t group) {
    const Group& g = hierarchy_.groups[group];
    visible_.assign(g.patch_count, 0);
    std::uint64_t triangles = 0;
    for (std::uint32_t i = 0; i < g.patch_count; ++i) {
      const Patch& patch = hierarchy_.patches[g.first_patch + i];
      visible_[i] = isVisible(patch) ? 1 : 0;
      if (visible_[i] != 0) triangles += patch.triangles;
    }
    return triangles;
  }

  std::uint64_t costOfConsumed(std::uint32_t group) const {
    if (!request_.cost) return 0;
    const Group& g = hierarchy_.groups[group];
    std::uint64_t cost = 0;
    for (std::uint32_t i = 0; i < g.patch_count; ++i) cost += request_.cost(hierarchy_.patches[g.first_patch + i]);
    return cost;
  }

  bool isVisible(const Patch& patch) const {
    if (request_.cull && (!frustum_.mayOverlap(patch.box) || isBeyond(request_.camera.section, patch.box)))
      return false;
    return !request_.cull_back_faces || !base::facesAway(patch.cone, patch.bounds, eyeFor(patch.bounds));
  }

  // For a parallel projection the eye is a place far away from each patch, ten thousand radii: its rays are parallel
  // within 1e-4 radian, and float32 still tells the radii apart.
  glm::vec3 eyeFor(const base::Sphere& bounds) const {
    constexpr float kFarAway = 1e4F;
    const base::Camera& camera = request_.camera;
    return camera.orthographic() ? bounds.center + kFarAway * bounds.radius * camera.towardsViewer(bounds.center)
                                 : camera.eye;
  }

  // Draws what the group consumes in place of what it produced; a group all of whose parents are expanded now is a
  // candidate.
  void expand(std::uint32_t group) {
    const Group& g = hierarchy_.groups[group];
    states_[group].expanded = true;
    cut_.expanded.push_back(group);
    for (std::uint32_t i = 0; i < g.patch_count; ++i) {
      const Patch& patch = hierarchy_.patches[g.first_patch + i];
      if (visible_[i] != 0) drawable_.push_back(g.first_patch + i);
      if (patch.producer >= states_.size() || !hierarchy_.isKnown(patch.producer)) continue;

      GroupProgress& producer = states_[patch.producer];
      if (visible_[i] != 0) producer.visible_triangles += patch.triangles;
      if (producer.last_parent == group) continue;
      producer.last_parent = group;
      ++producer.expanded_parents;
      if (producer.expanded_parents == hierarchy_.groups[patch.producer].parent_count) consider(patch.producer);
    }
  }

  // Called when the count of expanded parents is complete. The parents are checked once more, since the links of a
  // growing hierarchy may disagree.
  void consider(std::uint32_t group) {
    const auto parents = hierarchy_.parentsOf(group);
    if (!std::all_of(parents.begin(), parents.end(), [&](std::uint32_t parent) { return states_[parent].expanded; }))
      return;
    const base::Sphere& bounds = hierarchy_.groups[group].bounds;
    if (request_.cull && (!frustum_.mayOverlap(bounds) || isBeyond(request_.camera.section, bounds))) return;

    const float error_px = projectedErrorOf(group, request_.measure);
    if (request_.tolerance_px > 0.0F && !(error_px > request_.tolerance_px)) return;
    heap_.push({error_px, group});
  }

  // Pixels. A camera with NaN in it gives 0, so that the heap's order stays an order.
  float projectedErrorOf(std::uint32_t group, base::ErrorMeasure measure) const {
    return projectedErrorAt(group, errorOf(hierarchy_.groups[group], measure));
  }
  float projectedErrorOf(const Patch& patch, base::ErrorMeasure measure) const {
    if (patch.producer == kNoGroup) return 0.0F;
    const bool known = patch.producer < states_.size() && hierarchy_.isKnown(patch.producer);
    // A producer that isn't here has a sphere within its consumer's: at that one its error projects to a bound.
    return known ? projectedErrorOf(patch.producer, measure)
                 : projectedErrorAt(patch.consumer, ownErrorOf(patch, measure));
  }
  float projectedErrorAt(std::uint32_t group, float error) const {
    const float error_px =
        base::projectedError(error, hierarchy_.groups[group].bounds, request_.camera, request_.near_plane);
    return error_px > 0.0F ? error_px : 0.0F;
  }

  // The cut has the visible patches met on the way down whose producer was not expanded.
  void collectPatches() {
    cut_.triangles = 0;
    for (const std::uint32_t index : drawable_) {
      const Patch& patch = hierarchy_.patches[index];
      if (patch.producer < states_.size() && states_[patch.producer].expanded) continue;
      cut_.patches.push_back(index);
      cut_.triangles += patch.triangles;
      cut_.patch_error_px.push_back(projectedErrorOf(patch, request_.measure));
      cut_.error_px = std::max(cut_.error_px, cut_.patch_error_px.back());
      cut_.patch_bound_px.push_back(projectedErrorOf(patch, base::ErrorMeasure::kBound));
      cut_.bound_px = std::max(cut_.bound_px, cut_.patch_bound_px.back());
      cut_.shape_px = std::max(cut_.shape_px, projectedErrorOf(patch, base::ErrorMeasure::kShape));
    }
  }

  // They were popped largest first, except where a parent's error is a rounding below its child's.
  void sortWanted() {
    std::sort(wanted_.begin(), wanted_.end(), [](const Candidate& a, const Candidate& b) { return b < a; });
    for (const Candidate& want : wanted_) cut_.wanted.push_back(want.group);
  }

  const Hierarchy& hierarchy_;
  const CutRequest& request_;
  const std::function<bool(std::uint32_t)>& available_;
  base::Frustum frustum_;
  std::vector<GroupProgress> states_;
  std::priority_queue<Candidate> heap_;
  std::vector<Candidate> wanted_;
  std::vector<std::uint8_t> visible_;    ///< for the group measured last, one per consumed patch
  std::vector<std::uint32_t> drawable_;  ///< visible patches consumed by expanded groups
  Cut cut_;
};

}  // namespace

Cut selectCut(const Hierarchy& hierarchy, const CutRequest& request,
              const std::function<bool(std::uint32_t)>& available) {
  return CutSelection(hierarchy, request, available).run();
}

Cut selectUniformCut(const Hierarchy& hierarchy, float world_error) {
  const std::vector<Group>& groups = hierarchy.groups;

  // Parents have smaller numbers, so one pass decides.
  std::vector<std::uint8_t> expanded(groups.size(), 0);
  for (std::uint32_t g = 0; g < groups.size(); ++g) {
    if (!hierarchy.isKnown(g) || (g != 0 && !(groups[g].error > world_error))) continue;
    const auto parents = hierarchy.parentsOf(g);
    expanded[g] =
        std::all_of(parents.begin(), parents.end(), [&](std::uint32_t parent) { return expanded[parent] != 0; }) ? 1
                                                                                                                 : 0;
  }
  return cutOfExpanded(hierarchy, expanded);
}

Cut cutOfExpanded(const Hierarchy& hierarchy, const std::vector<std::uint8_t>& expanded) {
  Cut cut;
  const std::vector<Group>& groups = hierarchy.groups;
  for (std::uint32_t g = 0; g < groups.size(); ++g) {
    if (expanded[g] == 0) continue;
    cut.expanded.push_back(g);
    for (std::uint32_t i = groups[g].first_patch; i < groups[g].first_patch + groups[g].patch_count; ++i) {
      const Patch& patch = hierarchy.patches[i];
      if (patch.producer < groups.size() && expanded[patch.producer] != 0) continue;
      cut.patches.push_back(i);
      cut.triangles += patch.triangles;
    }
  }
  return cut;
}

UniformCut selectFinestUniformCut(const Hierarchy& hierarchy, std::uint64_t max_triangles) {
  // The errors of groups are the only ones at which cuts change.
  std::vector<float> errors{0.0F};
  for (std::uint32_t g = 0; g < hierarchy.groups.size(); ++g)
    if (hierarchy.isKnown(g) && std::isfinite(hierarchy.groups[g].error)) errors.push_back(hierarchy.groups[g].error);
  std::sort(errors.begin(), errors.end());
  const auto tooFine = [&](float error) { return selectUniformCut(hierarchy, error).triangles > max_triangles; };
  const auto at = std::partition_point(errors.begin(), errors.end(), tooFine);
  const float error = at == errors.end() ? errors.back() : *at;
  return {selectUniformCut(hierarchy, error), error};
}

}  // namespace lod::patch
