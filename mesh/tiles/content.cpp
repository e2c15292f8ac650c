#include "mesh/tiles/content.h"

#include <glm/gtc/matrix_transform.hpp>
#include <optional>
#include <string_view>

#include "mesh/gltf/document.h"

namespace mesh::tiles {
namespace {

using gltf::Document;
using gltf::json;
using gltf::member;

/// A batched model without its tables (section "Batched 3D Model").
struct BatchedModel {
  base::ByteView glb;
  std::uint64_t offset = 0;  // in the file
  glm::dvec3 center{0.0};    // of its coordinates, in those of the tile
};

// The centre stands in the table's JSON as numbers, or there as an offset into its binary part.
base::Result<glm::dvec3> centerOf(base::ByteView text, base::ByteView binary) {
  if (std::string_view rest = base::textOf(text); !skipSpaces(rest)) return glm::dvec3(0.0);
  const json table = json::parse(text.begin(), text.end(), nullptr, false);
  if (table.is_discarded()) return invalidInput("the JSON of its feature table is broken");
  const json& center = member(table, "RTC_CENTER");
  if (center.is_null()) return glm::dvec3(0.0);
  if (const auto numbers = gltf::numbers<glm::dvec3>(center)) return *numbers;
  const std::uint64_t offset = gltf::integer(member(center, "byteOffset"), gltf::kMissing);
  if (offset > binary.size() || binary.size() - offset < sizeof(glm::vec3))
    return invalidInput("RTC_CENTER reaches past its feature table");
  base::ByteReader reader(binary.subspan(static_cast<std::size_t>(offset)));
  return glm::dvec3(reader.read<glm::vec3>());
}

base::Result<BatchedModel> unwrap(base::ByteView bytes) {
  base::ByteReader reader(bytes);
  (void)reader.u32();  // "b3dm"
  const std::uint32_t version = reader.u32();
  const std::uint32_t length = reader.u32();
  const std::uint32_t feature_json = reader.u32();
  const std::uint32_t feature_binary = reader.u32();
  const std::uint32_t batch_json = reader.u32();
  const std::uint32_t batch_binary = reader.u32();
  if (!reader.ok()) return truncatedIn("its header");
  if (version != 1) return unsupported("b3dm version " + std::to_string(version) + " is not read (only 1 is)");
  if (length > bytes.size())
    return truncatedIn("byte " + std::to_string(bytes.size()) + " of " + std::to_string(length));
  const base::ByteView feature_text = reader.bytes(feature_json);
  const base::ByteView feature_bytes = reader.bytes(feature_binary);
  (void)reader.bytes(batch_json);
  (void)reader.bytes(batch_binary);
  if (!reader.ok() || reader.offset() > length)
    return invalidInput("its tables reach past its end (truncated, or of a version before 1.0?)");
  BatchedModel model;
  model.offset = reader.offset();
  model.glb = bytes.subspan(reader.offset(), length - reader.offset());
  LUMIGRID_ASSIGN_OR_RETURN(model.center, centerOf(feature_text, feature_bytes));
  return model;
}

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
  BatchedModel model{bytes, 0, glm::dvec3(0.0)};
  if (kindOf(bytes) == ContentKind::kBatchedModel) {
    LUMIGRID_ASSIGN_OR_RETURN(model, unwrap(bytes));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto document, Document::parse(model.glb, path, model.offset));
  // Older models have the centre in an extension of glTF's. Either is in the tile's axes.
  const json& center = member(gltf::extension(document.root(), "CESIUM_RTC"), "center");
  model.center += gltf::numbers<glm::dvec3>(center).value_or(glm::dvec3(0.0));
  const glm::dmat4 world_from_model = glm::translate(world_from_tile, model.center) * tileFromContent(up);
  return gltf::readScene(document, world_from_model, share, omissions, out);
}

}  // namespace mesh::tiles
