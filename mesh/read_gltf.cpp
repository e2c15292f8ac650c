// glTF 2.0, as one GLB or as a .gltf file with others beside it.
#include <nlohmann/json.hpp>

#include "mesh/gltf/document.h"
#include "mesh/gltf/reader.h"
#include "mesh/readers.h"
#include "mesh/tiles/tile_tree.h"

namespace mesh {
namespace {

base::Result<void> readAlone(gltf::Document document, MeshStream& out) {
  gltf::Omissions omissions;
  LUMIGRID_TRY(gltf::readScene(document, glm::dmat4(1.0), {}, omissions, out));
  if (out.triangleCount() == 0 && omissions.point_primitives > 0) {
    LUMIGRID_TRY(beginPoints(out));
    omissions = {};
    LUMIGRID_TRY(gltf::readScene(document, glm::dmat4(1.0), {}, omissions, out));
    if (out.vertexCount() == 0) return invalidInput("the file has no points");
  } else if (out.triangleCount() == 0) {
    return invalidInput("the file has no triangles");
  }
  omissions.describe(out.summary.warnings);
  out.summary.georeference.up = Georeference::Up::kY;  // glTF 2.0, section 3.4: +Y is up
  return out.handOver();
}

}  // namespace

base::Result<void> beginPoints(MeshStream& out) {
  if (!out.accepts_points) return unsupported(kOnlyPoints);
  out.reads_points = true;
  return out.restart();
}

base::Result<void> readGlb(base::ByteView bytes, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(auto document, gltf::Document::parse(bytes, out.textures.path()));
  return readAlone(std::move(document), out);
}

base::Result<void> readJson(base::ByteView bytes, MeshStream& out) {
  auto parsed = nlohmann::json::parse(bytes.begin(), bytes.end(), nullptr, false);
  if (!parsed.is_object()) return invalidInput("the JSON is broken (truncated?)");
  if (tiles::isTileset(parsed)) return readTileset(parsed, out);
  LUMIGRID_ASSIGN_OR_RETURN(auto document, gltf::Document::ofJson(std::move(parsed), bytes, out.textures.path()));
  return readAlone(std::move(document), out);
}

}  // namespace mesh
