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

void writeGroupRow(base::ByteWriter& out, const Group& group) {
  out.write(group.bounds);
  out.f32(group.error);
  out.f32(group.attribute_error);
  out.u32(group.level);
  out.u32(group.first_patch);
  out.u32(group.patch_count);
  out.u32(group.first_parent);
  out.u32(group.parent_count);
  out.u32(group.block_bytes);
  out.u64(group.block_offset);
}

Group readGroupRow(base::ByteReader& in) {
  Group group;
  group.bounds = in.read<base::Sphere>();
  group.error = in.f32();
  group.attribute_error = in.f32();
  group.level = in.u32();
  group.first_patch = in.u32();
  group.patch_count = in.u32();
  group.first_parent = in.u32();
  group.parent_count = in.u32();
  group.block_bytes = in.u32();
  group.block_offset = in.u64();
  return group;
}

void writePatchRow(base::ByteWriter& out, const Patch& patch) {
  out.write(patch.box);
  out.write(patch.bounds);
  out.write(patch.cone);
  out.u32(patch.producer);
  out.u32(patch.consumer);
  out.u32(patch.level);
  out.u32(patch.triangles);
  out.u32(patch.vertices);
  out.u32(patch.block_offset);
  out.u32(patch.block_bytes);
}

Patch readPatchRow(base::ByteReader& in) {
  Patch patch;
  patch.box = in.read<base::Aabb>();
  patch.bounds = in.read<base::Sphere>();
  patch.cone = in.read<base::NormalCone>();
  patch.producer = in.u32();
  patch.consumer = in.u32();
  patch.level = in.u32();
  patch.triangles = in.u32();
  patch.vertices = in.u32();
  patch.block_offset = in.u32();
  patch.block_bytes = in.u32();
  return patch;
}

const char* groupFault(const Group& group, std::uint32_t index) {
  if (!isSphere(group.bounds)) return "its sphere is not a sphere";
  if (group.patch_count == 0) return "it consumes no patches";
  if (!isFinite(group.attribute_error) || group.attribute_error < 0.0F)
    return "its attribute error is not a number from 0 up";
  if (index == 0) {
    if (!(group.error == std::numeric_limits<float>::infinity())) return "group 0 must have infinite error";
    return group.parent_count == 0 ? nullptr : "group 0 must have no parents";
  }
  if (!isFinite(group.error) || group.error < 0.0F) return "its error is not a number from 0 up";
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
  if (patch.producer != kNoGroup && patch.producer <= patch.consumer)
    return "its producer doesn't lie below its consumer";
  return nullptr;
}

bool contains(const base::Sphere& outer, const base::Sphere& inner) {
  const glm::dvec3 center(outer.center);
  const double distance = glm::length(glm::dvec3(inner.center) - center);
  return distance + inner.radius <= outer.radius * (1.0 + 1e-5) + 1e-6 * glm::length(center);
}

base::Error damaged(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, what + "; copy or build the file again"};
}
base::Error groupError(std::size_t group, const std::string& what) {
  return damaged("group " + std::to_string(group) + ": " + what);
}
base::Error patchError(std::size_t patch, const std::string& what) {
  return damaged("patch " + std::to_string(patch) + ": " + what);
}

}  // namespace lod::patch
