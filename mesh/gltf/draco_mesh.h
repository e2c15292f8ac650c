#pragma once
// KHR_draco_mesh_compression: primitives that libdraco decodes.
#include <memory>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/gltf/accessor.h"

namespace draco {
class Mesh;
}

namespace mesh::gltf {

/// A decoded primitive, which is a list of triangles.
class DracoMesh {
 public:
  /// Errors begin with `place`.
  static base::Result<DracoMesh> decode(base::ByteView compressed, const std::string& place);
  /// The corners of its triangles. All are below points().
  Accessor indices() const;
  std::uint64_t points() const;
  /// The attribute that has this number in the extension's object, a value for each point. Errors begin with `here`.
  base::Result<Accessor> attribute(std::uint64_t number, const std::string& here) const;

 private:
  explicit DracoMesh(std::shared_ptr<const draco::Mesh> mesh) : mesh_(std::move(mesh)) {}
  std::shared_ptr<const draco::Mesh> mesh_;
};

}  // namespace mesh::gltf
