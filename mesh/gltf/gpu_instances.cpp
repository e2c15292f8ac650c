#include "mesh/gltf/gpu_instances.h"

#include <algorithm>
#include <glm/gtc/quaternion.hpp>

#include "mesh/mesh_stream.h"

namespace mesh::gltf {
namespace {

const json& attributesOf(const json& node) {
  return member(extension(node, "EXT_mesh_gpu_instancing"), "attributes");
}

}  // namespace

double GpuInstances::claimedBy(const Document& document, const json& node) {
  const json& attributes = attributesOf(node);
  if (!attributes.is_object() || attributes.empty()) return 1.0;
  std::uint64_t most = 0;
  for (const json& attribute : attributes) {
    const json& accessor = item(document.list("accessors"), integer(attribute, kMissing));
    most = std::max(most, integer(member(accessor, "count"), 0));
  }
  return static_cast<double>(most);
}

base::Result<GpuInstances> GpuInstances::of(Document& document, const json& node, const std::string& place) {
  GpuInstances instances;
  const json& attributes = attributesOf(node);
  if (!attributes.is_object()) return instances;
  bool counted = false;
  for (const auto& [name, accessor] : attributes.items()) {
    const std::string here = place + ": " + inQuotes(name) + " of its instances";
    LUMIGRID_ASSIGN_OR_RETURN(const Accessor found, document.accessor(integer(accessor, kMissing), here));
    if (counted && found.count != instances.count_)
      return invalidInput(place + ": the attributes of its instances have different numbers of elements");
    instances.count_ = found.count;
    counted = true;
    // Others, such as "_ID", tell nothing of the place.
    const bool is_rotation = name == "ROTATION";
    if (!is_rotation && name != "TRANSLATION" && name != "SCALE") continue;
    if (found.components != (is_rotation ? 4U : 3U))
      return invalidInput(here + " has " + std::to_string(found.components) + " components");
    (is_rotation ? instances.rotation_ : name == "SCALE" ? instances.scale_ : instances.translation_) = found;
  }
  return instances;
}

glm::dmat4 GpuInstances::nodeFromMesh(std::uint64_t i) const {
  glm::dvec4 rotation(0.0, 0.0, 0.0, 1.0);
  if (rotation_) {
    rotation = glm::dvec4(rotation_->vector(i), rotation_->value(i, 3));
    // Normalised integers are a little off the unit length, which would scale the mesh.
    const double length = glm::length(rotation);
    if (length > 0.0) rotation /= length;
  }
  return matrixOf(translation_ ? translation_->vector(i) : glm::dvec3(0.0), rotation,
                  scale_ ? scale_->vector(i) : glm::dvec3(1.0));
}

glm::dmat4 matrixOf(const glm::dvec3& translation, const glm::dvec4& rotation, const glm::dvec3& scale) {
  glm::dmat4 matrix(glm::mat3_cast(glm::dquat(rotation.w, rotation.x, rotation.y, rotation.z)));
  for (int k = 0; k < 3; ++k) matrix[k] *= scale[k];
  matrix[3] = glm::dvec4(translation, 1.0);
  return matrix;
}

}  // namespace mesh::gltf
