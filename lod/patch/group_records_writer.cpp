// Writes the records of groups.
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/patch/codec/normals.h"
#include "lod/patch/codec/residual_writer.h"
#include "lod/patch/codec/residuals.h"
#include "lod/patch/group_records.h"
#include "lod/patch/record_fields.h"

namespace lod::patch {
namespace {

using namespace records;

/// Half of a chunk's patches have spheres of at least so many units. A choice: boxes grow by a hundredth or so, and a
/// number more or less of bits is 2 bytes of 20 a patch.
constexpr double kUnitsOfRadius = 128.0;
/// Lengths are less than this many units, so that sums of two fit 32 bits with a sign.
constexpr double kMaxUnits = 1 << 29;

float largestOf(const base::Sphere& s) {
  const glm::vec3 place = glm::abs(s.center);
  return std::max({place.x, place.y, place.z}) + s.radius;
}

// Rounds outwards as the reader sees it, floats included.
class Rounding {
 public:
  explicit Rounding(const Units& units) : units_(units) {}
  std::uint32_t down(float place, std::size_t axis) const {
    std::int64_t n = nearest(place, axis);
    while (units_.placeOf(static_cast<std::uint32_t>(n), axis) > place) --n;
    while (units_.placeOf(static_cast<std::uint32_t>(n + 1), axis) <= place) ++n;
    return static_cast<std::uint32_t>(n);
  }
  std::uint32_t up(float place, std::size_t axis) const {
    std::int64_t n = nearest(place, axis);
    while (units_.placeOf(static_cast<std::uint32_t>(n), axis) < place) ++n;
    while (units_.placeOf(static_cast<std::uint32_t>(n - 1), axis) >= place) --n;
    return static_cast<std::uint32_t>(n);
  }
  void sphere(const base::Sphere& s, Triple& center, std::uint32_t& radius) const {
    glm::dvec3 moved;
    for (std::size_t k = 0; k < 3; ++k) {
      const int axis = static_cast<int>(k);
      center[k] = static_cast<std::uint32_t>(nearest(s.center[axis], k));
      moved[axis] = double{units_.placeOf(center[k], k)} - s.center[axis];
    }
    const double needed = s.radius + glm::length(moved);
    radius = static_cast<std::uint32_t>(std::ceil(needed / units_.unit));
    while (double{static_cast<float>(units_.lengthOf(radius))} < needed) ++radius;
  }

 private:
  std::int64_t nearest(float place, std::size_t axis) const {
    return std::llround((double{place} - units_.origin[static_cast<int>(axis)]) / units_.unit);
  }
  Units units_;
};

// A cone around the stored axis that holds the patch's.
void storeCone(const base::NormalCone& cone, PatchNumbers& numbers) {
  numbers.angle = kAllDirections;
  numbers.axis_u = numbers.axis_v = 0;  // +z
  const double length = glm::length(glm::dvec3(cone.axis));
  if (!(length > 0.0) || cone.cos_angle <= -1.0F) return;
  codec::NormalBlock axis;
  axis.x[0] = cone.axis.x, axis.y[0] = cone.axis.y, axis.z[0] = cone.axis.z;
  std::int32_t u = 0, v = 0;
  codec::encodeNormals(axis, 1, &u, &v);
  codec::decodeNormals(&u, &v, 1, axis);
  const glm::dvec3 stored(axis.x[0], axis.y[0], axis.z[0]);
  const double between = std::acos(std::clamp(glm::dot(stored, glm::dvec3(cone.axis) / length), -1.0, 1.0));
  const double angle = std::acos(double{cone.cos_angle}) + between;
  if (angle >= std::numbers::pi) return;
  auto step = static_cast<std::uint32_t>(std::ceil(angle / std::numbers::pi * kAllDirections));
  while (step < kAllDirections && cosineOfAngle(step) > std::cos(angle)) ++step;
  numbers.angle = step;
  if (step == kAllDirections) return;
  numbers.axis_u = static_cast<std::uint32_t>(u);
  numbers.axis_v = static_cast<std::uint32_t>(v);
}

GroupNumbers numbersOf(const Group& group, const Rounding& rounding) {
  GroupNumbers numbers;
  rounding.sphere(group.bounds, numbers.center, numbers.radius);
  numbers.error = codeOfError(group.error);
  numbers.attribute_error = codeOfError(group.attribute_error);
  numbers.typical_error = codeOfError(group.typical_error);
  numbers.typical_color_error = codeOfError(group.typical_color_error);
  numbers.visible_error = codeOfError(group.visible_error);
  numbers.level = group.level;
  numbers.patches = group.patch_count;
  numbers.parents = group.parent_count;
  return numbers;
}

PatchNumbers numbersOf(const Hierarchy& hierarchy, const Patch& patch, const PatchNumbers& before,
                       const Rounding& rounding) {
  PatchNumbers numbers;
  numbers.level = patch.level;
  for (std::size_t k = 0; k < 3; ++k) {
    const int axis = static_cast<int>(k);
    numbers.corner[k] = rounding.down(patch.box.min[axis], k);
    numbers.extent[k] = rounding.up(patch.box.max[axis], k) - numbers.corner[k];
  }
  rounding.sphere(patch.bounds, numbers.center, numbers.radius);
  storeCone(patch.cone, numbers);
  numbers.color_detail = patch.color_detail;
  numbers.triangles = patch.triangles;
  numbers.vertices = patch.vertices;
  numbers.bytes = patch.block_bytes;
  if (patch.producer == kNoGroup) {
    numbers.producer = before.producer;
    numbers.error = before.error;
    numbers.typical_error = before.typical_error;
    numbers.visible_error = before.visible_error;
    return numbers;
  }
  const Group& producer = hierarchy.groups[patch.producer];
  numbers.producer = patch.producer;
  numbers.error = codeOfError(producer.error);
  numbers.typical_error = codeOfError(producer.typical_error);
  numbers.visible_error = codeOfError(producer.visible_error);
  return numbers;
}

// The unit of a chunk, as the power of two that the lattice's step is multiplied by.
unsigned unitShift(const Hierarchy& hierarchy, std::uint32_t first_group, std::uint32_t end_group) {
  std::vector<float> radii;
  double largest = 0.0;
  for (std::uint32_t g = first_group; g < end_group; ++g) {
    const Group& group = hierarchy.groups[g];
    largest = std::max(largest, double{largestOf(group.bounds)});
    for (std::uint32_t i = group.first_patch; i < group.first_patch + group.patch_count; ++i) {
      radii.push_back(hierarchy.patches[i].bounds.radius);
      largest = std::max(largest, double{largestOf(hierarchy.patches[i].bounds)});
    }
  }
  std::nth_element(radii.begin(), radii.begin() + static_cast<std::ptrdiff_t>(radii.size() / 2), radii.end());
  const double usual = double{radii[radii.size() / 2]};
  const glm::dvec3 origin = glm::abs(hierarchy.lattice.origin);
  largest += std::max({origin.x, origin.y, origin.z});
  unsigned shift = 0;
  double unit = hierarchy.lattice.step;
  while (shift < kMaxUnitShift && (2.0 * unit <= usual / kUnitsOfRadius || unit * kMaxUnits <= largest))
    ++shift, unit *= 2.0;
  return shift;
}

// Planes of residuals, one for each number of a row.
template <std::size_t kPlanes>
class Planes {
 public:
  explicit Planes(std::size_t rows) {
    for (auto& plane : planes_) plane.assign(codec::groupsOf(rows) * codec::kGroup, 0);
  }
  /// Sets the residual of the row's next number.
  void set(std::size_t row, std::size_t plane, std::uint32_t number, std::uint32_t predicted) {
    planes_[plane][row] = codec::zigzag(static_cast<std::int32_t>(number - predicted));
  }
  void write(base::ByteWriter& out) const {
    codec::ResidualWriter writer(planes_[0].size());
    for (const auto& plane : planes_) writer.write(out, plane);
  }

 private:
  std::array<std::vector<std::uint32_t>, kPlanes> planes_;
};

base::Bytes encodeChunk(const Hierarchy& hierarchy, std::uint32_t first_group, std::uint32_t end_group) {
  const Group& first = hierarchy.groups[first_group];
  const unsigned shift = unitShift(hierarchy, first_group, end_group);
  const Rounding rounding({hierarchy.lattice.origin, std::ldexp(hierarchy.lattice.step, static_cast<int>(shift))});

  std::vector<GroupNumbers> groups;
  std::vector<PatchNumbers> patches;
  PatchNumbers before;
  for (std::uint32_t g = first_group; g < end_group; ++g) {
    const Group& group = hierarchy.groups[g];
    groups.push_back(numbersOf(group, rounding));
    for (std::uint32_t i = group.first_patch; i < group.first_patch + group.patch_count; ++i) {
      patches.push_back(numbersOf(hierarchy, hierarchy.patches[i], before, rounding));
      before = patches.back();
    }
  }

  // The first row's numbers lie in front, where a residual of their size would widen those of others.
  base::ByteWriter out;
  out.u32(first.first_patch);
  out.u64(first.block_offset);
  out.u8(static_cast<std::uint8_t>(shift));
  const auto number = [&out](std::uint32_t value, std::uint32_t) { out.varint(value); };
  GroupNumbers first_numbers = groups.front();
  visitNumbers(first_numbers, {}, number);
  PatchNumbers start;
  start.producer = patches.front().producer;
  start.typical_error = patches.front().typical_error;
  start.error = patches.front().error;
  start.visible_error = patches.front().visible_error;
  for (const std::uint32_t value : {start.producer, start.typical_error, start.error, start.visible_error})
    out.varint(value);

  Planes<kGroupPlanes> group_planes(groups.size());
  Planes<kPatchPlanes> patch_planes(patches.size());
  std::vector<std::uint32_t> parents;
  std::uint32_t parent_before = first_group;
  std::size_t p = 0;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    std::size_t plane = 0;
    GroupNumbers row = groups[g];
    visitNumbers(row, groups[g == 0 ? 0 : g - 1],
                 [&](std::uint32_t value, std::uint32_t predicted) { group_planes.set(g, plane++, value, predicted); });
    for (std::uint32_t i = 0; i < groups[g].patches; ++i, ++p) {
      plane = 0;
      PatchNumbers patch = patches[p];
      visitNumbers(
          patch, p == 0 ? start : patches[p - 1], groups[g],
          [&](std::uint32_t value, std::uint32_t predicted) { patch_planes.set(p, plane++, value, predicted); });
    }
    for (const std::uint32_t parent : hierarchy.parentsOf(first_group + static_cast<std::uint32_t>(g))) {
      parents.push_back(codec::zigzag(static_cast<std::int32_t>(parent - parent_before)));
      parent_before = parent;
    }
  }
  group_planes.write(out);
  parents.resize(codec::groupsOf(parents.size()) * codec::kGroup);
  if (!parents.empty()) codec::ResidualWriter(parents.size()).write(out, parents);
  patch_planes.write(out);

  base::ByteWriter sealed;
  sealed.u32(base::crc32c(out.view()));
  sealed.bytes(out.view());
  return sealed.takeBytes();
}

}  // namespace

base::Bytes encodeRecords(const Hierarchy& hierarchy, std::uint64_t patch_bytes) {
  base::ByteWriter directory, chunks;
  const auto groups = static_cast<std::uint32_t>(hierarchy.groups.size());
  LUMIGRID_CHECK(groups > 0 && hierarchy.known.empty());
  for (std::uint32_t g = 0; g < groups; g += GroupRecords::kGroupsPerChunk) {
    const base::Bytes chunk = encodeChunk(hierarchy, g, std::min(g + GroupRecords::kGroupsPerChunk, groups));
    directory.varint(chunk.size());
    chunks.bytes(chunk);
  }
  const auto front = static_cast<std::uint32_t>(RecordCounts::kHeaderBytes + directory.view().size());
  base::ByteWriter out;
  out.bytes(base::viewOfText(kRecordsMagic));
  out.u32(kRecordsVersion);
  out.u32(front);
  out.u64(front + chunks.view().size());
  out.u64(patch_bytes);
  for (int k = 0; k < 3; ++k) out.f64(hierarchy.lattice.origin[k]);
  out.f64(hierarchy.lattice.step);
  out.u64(hierarchy.source_triangles);
  out.u32(hierarchy.has_colors ? kColorsFlag : 0U);
  out.u32(groups);
  out.u32(static_cast<std::uint32_t>(hierarchy.patches.size()));
  out.u32(GroupRecords::kGroupsPerChunk);
  out.u32(base::crc32c(directory.view()));
  out.u32(base::crc32c(out.view()));
  LUMIGRID_CHECK_EQ(out.view().size(), std::size_t{RecordCounts::kHeaderBytes});
  out.bytes(directory.view());
  out.bytes(chunks.view());
  return out.takeBytes();
}

}  // namespace lod::patch
