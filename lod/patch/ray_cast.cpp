#include "lod/patch/ray_cast.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <queue>
#include <string>
#include <utility>

#include "lod/patch/format.h"
#include "lod/patch/ray_triangle.h"
#include "lod/patch/records.h"

namespace lod::patch {
namespace {

/// Spheres hold what is below them up to the rounding of floats (records.h, contains), which adds up over levels. The
/// slacks are choices: larger ones only test more spheres.
constexpr double kSphereSlack = 1e-4;
constexpr double kCenterSlack = 1e-6;

bool isFinite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// The next thing that the walk comes to: a group to go through, or a patch to test.
struct Stop {
  double entry = 0.0;  ///< not farther than anything in it
  bool is_patch = false;
  std::uint32_t index = 0;

  // Heap order: the nearest on top, groups before patches, then the smallest number.
  bool operator<(const Stop& other) const {
    if (entry != other.entry) return entry > other.entry;
    return is_patch != other.is_patch ? is_patch : index > other.index;
  }
};

class RayWalk {
 public:
  RayWalk(const Hierarchy& hierarchy, const Ray& ray, const BlockSource& blocks)
      : hierarchy_(hierarchy),
        origin_(ray.origin),
        direction_(glm::normalize(ray.direction / largestOf(ray.direction))),
        limit_(ray.max_distance),
        blocks_(blocks),
        sheared_(origin_, direction_) {}

  base::Result<RayCast> throughGroups(float tolerance) {
    tolerance_ = tolerance;
    visited_.assign(hierarchy_.groups.size(), false);
    heap_.push({0.0, false, 0});
    return walk();
  }

 private:
  static double largestOf(const glm::dvec3& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

  // Takes the nearest stop first, until all others begin behind the hit.
  base::Result<RayCast> walk() {
    while (!heap_.empty()) {
      const Stop next = heap_.top();
      heap_.pop();
      if (next.entry > limit_) break;
      LUMIGRID_TRY(next.is_patch ? testPatch(next) : expand(next));
    }
    RayCast cast;
    for (const Stop& need : needed_)
      if (need.entry <= limit_ && std::find(cast.needed.begin(), cast.needed.end(), need.index) == cast.needed.end())
        cast.needed.push_back(need.index);
    cast.hit = hit_;
    return cast;
  }

  // Pushes every patch that the group consumes if it is in the cut, else its producer.
  base::Result<void> expand(const Stop& stop) {
    if (!isHere(stop.index)) {
      needed_.push_back(stop);
      return {};
    }
    const Group& group = hierarchy_.groups[stop.index];
    for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
      const Patch& patch = hierarchy_.patches[p];
      if (patch.producer == kNoGroup || (tolerance_ > 0.0F && !(errorOf(patch) > tolerance_))) {
        pushPatch(p);
      } else {
        pushProducer(patch);
      }
    }
    return {};
  }

  // The error that the producer states or, if that is not here, the one that came with the patch.
  float errorOf(const Patch& patch) const {
    if (patch.producer == kNoGroup) return 0.0F;
    return isHere(patch.producer) ? hierarchy_.groups[patch.producer].error : patch.own_error;
  }

  bool isHere(std::uint32_t group) const { return group < hierarchy_.groups.size() && hierarchy_.isKnown(group); }

  void pushPatch(std::uint32_t index) {
    // A step is twice the slack that the rounding of points to floats needs.
    if (const auto entry = entryOf(hierarchy_.patches[index].box, hierarchy_.lattice.step))
      heap_.push({*entry, true, index});
  }

  // All geometry below a group lies in its sphere. If its record is not here yet: within its error of its products.
  void pushProducer(const Patch& patch) {
    const std::uint32_t producer = patch.producer;
    if (isHere(producer)) {
      if (visited_[producer]) return;
      visited_[producer] = true;
      if (const auto entry = entryOf(hierarchy_.groups[producer].bounds)) heap_.push({*entry, false, producer});
    } else if (const auto entry = entryOf(patch.box, static_cast<double>(errorOf(patch)) + hierarchy_.lattice.step)) {
      heap_.push({*entry, false, producer});
    }
  }

  // Starts from the ray's nearest point to the centre: squared distances would lose all precision from far away.
  std::optional<double> entryOf(const base::Sphere& sphere) const {
    const glm::dvec3 center(sphere.center);
    const double radius = static_cast<double>(sphere.radius) * (1.0 + kSphereSlack) + largestOf(center) * kCenterSlack;
    const glm::dvec3 to_center = center - origin_;
    const double along = glm::dot(to_center, direction_);
    const glm::dvec3 aside = to_center - along * direction_;
    const double half_chord_squared = radius * radius - glm::dot(aside, aside);
    if (half_chord_squared < 0.0) return std::nullopt;
    const double half_chord = std::sqrt(half_chord_squared);
    if (along + half_chord < 0.0) return std::nullopt;
    return std::max(0.0, along - half_chord);
  }

  std::optional<double> entryOf(const base::Aabb& box, double slack) const {
    double enter = 0.0;
    double leave = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      const double low = static_cast<double>(box.min[axis]) - slack - origin_[axis];
      const double high = static_cast<double>(box.max[axis]) + slack - origin_[axis];
      if (direction_[axis] == 0.0) {
        if (low > 0.0 || high < 0.0) return std::nullopt;
        continue;
      }
      const double a = low / direction_[axis];
      const double b = high / direction_[axis];
      enter = std::max(enter, std::min(a, b));
      leave = std::min(leave, std::max(a, b));
    }
    if (enter > leave) return std::nullopt;
    return enter;
  }

  base::Result<void> testPatch(const Stop& stop) {
    const Patch& patch = hierarchy_.patches[stop.index];
    LUMIGRID_ASSIGN_OR_RETURN(const auto block, blocks_(patch.consumer));
    if (!block.has_value()) {
      needed_.push_back({stop.entry, false, patch.consumer});
      return {};
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, decode(stop.index, *block));
    intersect(stop.index, geometry);
    return {};
  }

  base::Result<PatchGeometry> decode(std::uint32_t index, base::ByteView block) const {
    const Patch& patch = hierarchy_.patches[index];
    const std::string place = "group " + std::to_string(patch.consumer) + ", patch " + std::to_string(index);
    if (block.size() != hierarchy_.groups[patch.consumer].block_bytes ||
        std::uint64_t{patch.block_offset} + patch.block_bytes > block.size())
      return base::within(place, damaged("its block has not the length of its record"));
    auto geometry = decodeRow(patch, block.subspan(patch.block_offset, patch.block_bytes));
    if (!geometry) return base::within(place, geometry.error());
    return geometry;
  }

  void intersect(std::uint32_t index, const PatchGeometry& geometry) {
    corners_.clear();
    for (const glm::ivec3& q : geometry.positions) corners_.emplace_back(hierarchy_.lattice.position(q));
    for (std::uint32_t t = 0; t < geometry.indices.size() / 3; ++t) {
      const glm::dvec3& a = corners_[geometry.indices[std::size_t{3} * t]];
      const glm::dvec3& b = corners_[geometry.indices[std::size_t{3} * t + 1]];
      const glm::dvec3& c = corners_[geometry.indices[std::size_t{3} * t + 2]];
      const auto hit = sheared_.meets(a, b, c);
      if (!hit || !(hit->distance >= 0.0) || hit->distance > limit_ || !comesFirst(hit->distance, index, t)) continue;
      const glm::dvec3 across = glm::cross(b - a, c - a);
      const double length = glm::length(across);
      if (!(length > 0.0)) continue;
      recordHit(index, t, *hit, across / length);
    }
  }

  bool comesFirst(double distance, std::uint32_t patch, std::uint32_t triangle) const {
    if (!hit_ || distance != hit_->distance) return !hit_ || distance < hit_->distance;
    return std::pair(patch, triangle) < std::pair(hit_->patch, hit_->triangle);
  }

  void recordHit(std::uint32_t index, std::uint32_t triangle, const TriangleHit& hit, const glm::dvec3& normal) {
    const Patch& patch = hierarchy_.patches[index];
    RayHit result;
    result.distance = limit_ = hit.distance;
    result.point = origin_ + hit.distance * direction_;
    result.normal = normal;
    result.front = glm::dot(normal, direction_) < 0.0;
    result.accuracy = hierarchy_.lattice.step + static_cast<double>(errorOf(patch));
    result.group = patch.consumer;
    result.patch = index;
    result.triangle = triangle;
    result.weights = hit.weights;
    hit_ = result;
  }

  const Hierarchy& hierarchy_;
  glm::dvec3 origin_;
  glm::dvec3 direction_;  ///< unit
  double limit_;          ///< the largest distance asked for, then that of the hit
  const BlockSource& blocks_;
  ShearedRay sheared_;
  float tolerance_ = 0.0F;
  std::vector<bool> visited_;  ///< groups already tested: a group has several patches, and several parents
  std::priority_queue<Stop> heap_;
  std::vector<Stop> needed_;  ///< groups, nearest first
  std::vector<glm::dvec3> corners_;
  std::optional<RayHit> hit_;
};

base::Result<void> checkRay(const Ray& ray) {
  if (!isFinite(ray.origin) || !isFinite(ray.direction) || ray.direction == glm::dvec3(0.0) ||
      !(ray.max_distance >= 0.0))
    return base::Error{base::ErrorCode::kInvalidInput,
                       "ray cast: a ray needs a finite origin, a finite direction other than zero and a distance of at "
                       "least 0"};
  return {};
}

}  // namespace

BlockSource blocksOf(const PatchFile& file) {
  // Several patches of one block are mostly asked for one after the other.
  struct HeldBlock {
    std::optional<std::uint32_t> group;
    base::Bytes bytes;
  };
  return [&file,
          held = std::make_shared<HeldBlock>()](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
    if (held->group != group) {
      held->group.reset();
      LUMIGRID_ASSIGN_OR_RETURN(held->bytes, file.block(group));
      held->group = group;
    }
    return std::optional(base::ByteView(held->bytes));
  };
}

base::Result<RayCast> castRay(const Hierarchy& hierarchy, const Ray& ray, const BlockSource& blocks, float tolerance) {
  LUMIGRID_TRY(checkRay(ray));
  if (!(tolerance >= 0.0F)) return base::Error{base::ErrorCode::kInvalidInput, "ray cast: a tolerance is at least 0"};
  return RayWalk(hierarchy, ray, blocks).throughGroups(tolerance);
}

}  // namespace lod::patch
