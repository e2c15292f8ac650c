#pragma once
// EXT_mesh_gpu_instancing: a node that shows its mesh once for each element of some accessors.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <string>

#include "base/error.h"
#include "mesh/gltf/document.h"

namespace mesh::gltf {

class GpuInstances {
 public:
  /// How many instances the node claims to have, before anything is read; 1 for a node without the extension.
  static double claimedBy(const Document& document, const json& node);
  /// One instance, which stays where the node is, for a node without the extension. Errors begin with `place`:
  /// kInvalidInput.
  static base::Result<GpuInstances> of(Document& document, const json& node, const std::string& place);

  std::uint64_t count() const { return count_; }
  /// Where instance i < count() stands.
  glm::dmat4 nodeFromMesh(std::uint64_t i) const;

 private:
  std::uint64_t count_ = 1;
  std::optional<Accessor> translation_, rotation_, scale_;
};

/// A translation, a rotation as x y z w, and a scale as one matrix, in glTF's order (section 3.5.3).
glm::dmat4 matrixOf(const glm::dvec3& translation, const glm::dvec4& rotation, const glm::dvec3& scale);

}  // namespace mesh::gltf
