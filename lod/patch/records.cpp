#include "lod/patch/records.h"

#include <cmath>

#include "lod/patch/codec.h"

namespace lod::patch {
namespace {

bool isFinite(float x) {
  return std::isfinite(x);
}
bool isFinite(const glm::vec3& v) {
  return isFinite(v.x) && isFinite(v.y) && isFinite(v.z);
}
bool isSphere(const base::Sphere& s) {
  return isFinite(s.center) && isFinite(s.radius) && s.radius >= 0.0F;
}

}  // namespace

const char* groupFault(const Group& group, std::uint32_t index) {
  if (!isSphere(group.bounds)) return "its sphere is not a sphere";
  if (group.patch_count == 0) return "it consumes no patches";
  if (!isFinite(group.attribute_error) || group.attribute_error < 0.0F)
    return "its attribute error is not a number from 0 up";
  if (!isFinite(group.typical_color_error) || group.typical_color_error < 0.0F)
    return "its typical colour error is not a number from 0 up";
  if (index == 0) {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    if (group.error != kInfinity || group.typical_error != kInfinity || group.visible_error != kInfinity)
      return "group 0 must have infinite errors";
    return group.parent_count == 0 ? nullptr : "group 0 must have no parents";
  }
  for (const float error : {group.error, group.typical_error, group.visible_error})
    if (!isFinite(error) || error < 0.0F) return "its error is not a number from 0 up";
  if (group.level == 0) return "its level is 0, which is the leaves'";
  return group.parent_count > 0 ? nullptr : "it has no parents";
}

const char* patchFault(const Patch& patch) {
  if (!isFinite(patch.box.min) || !isFinite(patch.box.max) || patch.box.empty()) return "its box is not a box";
  if (!isSphere(patch.bounds)) return "its sphere is not a sphere";
  if (!isFinite(patch.cone.axis) || !(patch.cone.cos_angle >= -1.0F && patch.cone.cos_angle <= 1.0F))
    return "its normal cone is not a cone";
  if (patch.triangles == 0 || patch.triangles > kMaxPatchTriangles) return "its triangle count is 0 or above 65535";
  if (patch.vertices == 0 || patch.vertices > kMaxPatchVertices) return "its vertex count is 0 or above 65535";
  if ((patch.producer == kNoGroup) != (patch.level == 0))
    return "a leaf has level 0 and no producer, any other patch both";
  if (patch.producer != kNoGroup && patch.color_detail != 0) return "it has a texture's detail but is no leaf";
  if (patch.producer != kNoGroup && patch.producer <= patch.consumer)
    return "its producer doesn't lie below its consumer";
  return nullptr;
}

base::Result<void> checkGroupRow(const Group& group, std::uint32_t index, std::uint64_t patches,
                                 std::uint64_t parents) {
  if (const char* fault = groupFault(group, index)) return groupError(index, fault);
  if (std::uint64_t{group.first_patch} + group.patch_count > patches)
    return groupError(index, "consumes patches that aren't there");
  if (std::uint64_t{group.first_parent} + group.parent_count > parents)
    return groupError(index, "its parents aren't in the table");
  return {};
}

base::Result<PatchGeometry> decodeRow(const Patch& row, base::ByteView bytes) {
  auto geometry = decodePatch(bytes);
  if (geometry &&
      (geometry->indices.size() != std::size_t{row.triangles} * 3 || geometry->positions.size() != row.vertices))
    return damaged("its counts are not its record's");
  return geometry;
}

bool contains(const base::Sphere& outer, const base::Sphere& inner) {
  const glm::dvec3 center(outer.center);
  const double distance = glm::length(glm::dvec3(inner.center) - center);
  return distance + inner.radius <= outer.radius * (1.0 + 1e-5) + 1e-6 * glm::length(center);
}

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; copy or build the file again"};
}
base::Error groupError(std::size_t group, const std::string& problem) {
  return damaged("group " + std::to_string(group) + ": " + problem);
}
base::Error patchError(std::size_t patch, const std::string& problem) {
  return damaged("patch " + std::to_string(patch) + ": " + problem);
}

}  // namespace lod::patch
