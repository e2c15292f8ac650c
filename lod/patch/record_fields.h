#pragma once
// Shared by writer and reader of the records (docs/formats/records.md): the numbers of a chunk, how each is predicted,
// and the steps in which they are stored. Private to lod/patch.
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "base/bytes.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch::records {

inline constexpr char kRecordsMagic[] = "LGGROUP\n";
inline constexpr std::uint32_t kRecordsVersion = 1;
inline constexpr std::uint32_t kColorsFlag = 1;
/// A chunk's unit of length is the lattice's step times two to this at most.
inline constexpr unsigned kMaxUnitShift = 40;
/// Blocks of patch.lgp begin at multiples of this.
inline constexpr std::uint64_t kBlockMultiple = 16;

using Triple = std::array<std::uint32_t, 3>;

/// The numbers of a group. Lengths are in units, as two's complement; errors are codes.
struct GroupNumbers {
  Triple center{};
  std::uint32_t radius = 0;
  std::uint32_t error = 0, attribute_error = 0, typical_error = 0, typical_color_error = 0, visible_error = 0;
  std::uint32_t level = 0, patches = 0, parents = 0;
};
inline constexpr std::size_t kGroupPlanes = 12;

/// The numbers of a patch. A leaf has the producer and errors of the patch before it, which say nothing.
struct PatchNumbers {
  std::uint32_t level = 0, producer = 0;
  Triple corner{}, extent{}, center{};
  std::uint32_t radius = 0, axis_u = 0, axis_v = 0, angle = 0, color_detail = 0;
  std::uint32_t triangles = 0, vertices = 0, bytes = 0;
  std::uint32_t error = 0, typical_error = 0, visible_error = 0;
};
inline constexpr std::size_t kPatchPlanes = 22;

/// Calls visit(number, its prediction) for each number of the group, in the order of the planes. Numbers before it are
/// known by then. `before`: the group before it.
template <class Visit>
void visitNumbers(GroupNumbers& n, const GroupNumbers& before, const Visit& visit) {
  for (std::size_t k = 0; k < 3; ++k) visit(n.center[k], before.center[k]);
  visit(n.radius, before.radius);
  visit(n.error, before.error);
  visit(n.attribute_error, before.attribute_error);
  visit(n.typical_error, before.typical_error);
  visit(n.typical_color_error, before.typical_color_error);
  visit(n.visible_error, before.visible_error);
  visit(n.level, before.level);
  visit(n.patches, before.patches);
  visit(n.parents, before.parents);
}

/// The same of a patch of the group.
template <class Visit>
void visitNumbers(PatchNumbers& n, const PatchNumbers& before, const GroupNumbers& group, const Visit& visit) {
  visit(n.level, group.level - 1);
  visit(n.producer, before.producer);
  for (std::size_t k = 0; k < 3; ++k) visit(n.corner[k], group.center[k]);
  for (std::size_t k = 0; k < 3; ++k) visit(n.extent[k], before.extent[k]);
  for (std::size_t k = 0; k < 3; ++k) visit(n.center[k], n.corner[k] + n.extent[k] / 2);
  visit(n.radius, (n.extent[0] + n.extent[1] + n.extent[2]) / 3);
  visit(n.axis_u, before.axis_u);
  visit(n.axis_v, before.axis_v);
  visit(n.angle, before.angle);
  visit(n.color_detail, before.color_detail);
  visit(n.triangles, before.triangles);
  visit(n.vertices, n.triangles / 2 + before.vertices - before.triangles / 2);
  // Patches of one level have about as many bytes a triangle.
  visit(n.bytes, before.triangles == 0
                     ? 0U
                     : static_cast<std::uint32_t>(std::uint64_t{before.bytes} * n.triangles / before.triangles));
  visit(n.typical_error, before.typical_error);
  visit(n.error, n.typical_error + before.error - before.typical_error);
  visit(n.visible_error, n.typical_error + before.visible_error - before.typical_error);
}

// Errors are stored as the upper 15 bits of a float.
inline std::uint32_t codeOfError(float error) {
  return base::bitCast<std::uint32_t>(errorRoundedUp(error + 0.0F)) >> kErrorShift;  // −0 becomes 0
}
inline float errorOfCode(std::uint32_t code) {
  return base::bitCast<float>(code << kErrorShift);
}

// Cones have 256 angles, from 0 to all directions.
inline constexpr std::uint32_t kAllDirections = 255;
inline float cosineOfAngle(std::uint32_t angle) {
  if (angle >= kAllDirections) return -1.0F;
  return static_cast<float>(std::cos(std::numbers::pi * angle / kAllDirections));
}

/// Where numbers of a chunk are: place = origin + unit · number.
struct Units {
  glm::dvec3 origin{0.0};
  double unit = 1.0;

  float placeOf(std::uint32_t number, std::size_t axis) const {
    return static_cast<float>(origin[static_cast<int>(axis)] + lengthOf(number));
  }
  double lengthOf(std::uint32_t number) const { return unit * static_cast<std::int32_t>(number); }
};

}  // namespace lod::patch::records
