#include "lod/patch/records.h"

#include <cmath>

#include "base/fields.h"
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

auto fieldsOfGroup(auto& g) {
  return std::tie(g.bounds, g.error, g.attribute_error, g.level, g.first_patch, g.patch_count, g.first_parent,
                  g.parent_count, g.block_bytes, g.block_offset);
}
auto fieldsOfPatch(auto& p) {
  return std::tie(p.box, p.bounds, p.cone, p.producer, p.consumer, p.level, p.triangles, p.vertices, p.block_offset,
                  p.block_bytes);
}

}  // namespace

void writeGroupRow(base::ByteWriter& out, const Group& group) {
  base::writeFields(out, fieldsOfGroup(group));
}

Group readGroupRow(base::ByteReader& in) {
  Group group;
  base::readFields(in, fieldsOfGroup(group));
  return group;
}

void writePatchRow(base::ByteWriter& out, const Patch& patch) {
  base::writeFields(out, fieldsOfPatch(patch));
}

Patch readPatchRow(base::ByteReader& in) {
  Patch patch;
  base::readFields(in, fieldsOfPatch(patch));
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
