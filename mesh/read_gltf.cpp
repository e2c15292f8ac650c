// glTF 2.0, as one GLB or as a .gltf file with others beside it.
#include "mesh/gltf/document.h"
#include "mesh/gltf/reader.h"
#include "mesh/readers.h"

namespace mesh {

base::Result<void> readGltf(base::ByteView bytes, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(auto document, gltf::Document::parse(bytes, out.textures.path()));
  gltf::Omissions omissions;
  LUMIGRID_TRY(gltf::readScene(document, glm::dmat4(1.0), {}, omissions, out));
  if (out.triangleCount() == 0) return invalidInput("the file has no triangles");
  omissions.describe(out.summary.warnings);
  return out.flush(bytes.data() + bytes.size());
}

}  // namespace mesh
