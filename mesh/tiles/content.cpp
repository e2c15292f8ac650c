#include "mesh/tiles/content.h"

#include <glm/gtc/matrix_transform.hpp>
#include <string_view>

#include "mesh/gltf/document.h"
#include "mesh/tiles/feature_table.h"
#include "mesh/tiles/points.h"

namespace mesh::tiles {
namespace {

using gltf::Document;
using gltf::json;
using gltf::member;

glm::dmat4 tileFromContent(UpAxis up) {
  glm::dmat4 turned(1.0);
  if (up == UpAxis::kY) {
    turned[1] = {0.0, 0.0, 1.0, 0.0};
    turned[2] = {0.0, -1.0, 0.0, 0.0};
  } else if (up == UpAxis::kX) {
    turned[0] = {0.0, 0.0, 1.0, 0.0};
    turned[2] = {-1.0, 0.0, 0.0, 0.0};
  }
  return turned;
}

}  // namespace

ContentKind kindOf(base::ByteView begin) {
  std::string_view text = base::textOf(begin);
  const std::string_view magic = text.substr(0, 4);
  if (magic == "glTF") return ContentKind::kGlb;
  if (magic == "b3dm") return ContentKind::kBatchedModel;
  if (magic == "i3dm") return ContentKind::kInstancedModels;
  if (magic == "pnts") return ContentKind::kPoints;
  if (magic == "cmpt") return ContentKind::kComposite;
  if (magic.substr(0, 2) == "\x1F\x8B") return ContentKind::kGzip;
  return looksLikeJson(text) ? ContentKind::kJson : ContentKind::kUnknown;
}

base::Result<void> readContent(base::ByteView bytes, const std::string& path, const glm::dmat4& world_from_tile,
                               UpAxis up, const gltf::ShareOfSource& share, gltf::Omissions& omissions,
                               MeshStream& out) {
  const ContentKind kind = kindOf(bytes);
  if (kind == ContentKind::kPoints) {
    if (out.reads_points) return readPoints(bytes, world_from_tile, share, out);
    ++omissions.point_primitives;
    return {};
  }
  FeatureTable table;
  table.body = bytes;
  if (kind == ContentKind::kBatchedModel) {
    LUMIGRID_ASSIGN_OR_RETURN(table, FeatureTable::parse(bytes, "b3dm"));
  }
  LUMIGRID_ASSIGN_OR_RETURN(glm::dvec3 middle, table.center());
  LUMIGRID_ASSIGN_OR_RETURN(auto document, Document::parse(table.body, path, table.body_offset));
  // Older models have the centre in an extension of glTF's. Either is in the tile's axes.
  const json& center = member(gltf::extension(document.root(), "CESIUM_RTC"), "center");
  middle += gltf::numbers<glm::dvec3>(center).value_or(glm::dvec3(0.0));
  const glm::dmat4 world_from_model = glm::translate(world_from_tile, middle) * tileFromContent(up);
  return gltf::readScene(document, world_from_model, share, omissions, out);
}

}  // namespace mesh::tiles
