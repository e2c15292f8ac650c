#include "mesh/tiles/feature_table.h"

#include <string_view>

#include "mesh/mesh_stream.h"

namespace mesh::tiles {

using gltf::json;
using gltf::member;

base::Result<FeatureTable> FeatureTable::parse(base::ByteView bytes, const char* name) {
  base::ByteReader reader(bytes);
  (void)reader.u32();  // its name
  const std::uint32_t version = reader.u32();
  const std::uint32_t length = reader.u32();
  const std::uint32_t feature_json = reader.u32();
  const std::uint32_t feature_binary = reader.u32();
  const std::uint32_t batch_json = reader.u32();
  const std::uint32_t batch_binary = reader.u32();
  if (!reader.ok()) return truncatedIn("its header");
  if (version != 1)
    return unsupported(std::string(name) + " version " + std::to_string(version) + " is not read (only 1 is)");
  if (length > bytes.size())
    return truncatedIn("byte " + std::to_string(bytes.size()) + " of " + std::to_string(length));
  const base::ByteView text = reader.bytes(feature_json);
  FeatureTable table;
  table.binary = reader.bytes(feature_binary);
  (void)reader.bytes(batch_json);
  (void)reader.bytes(batch_binary);
  if (!reader.ok() || reader.offset() > length)
    return invalidInput("its tables reach past its end (truncated, or of a version before 1.0?)");
  table.body_offset = reader.offset();
  table.body = bytes.subspan(reader.offset(), length - reader.offset());
  if (std::string_view rest = base::textOf(text); !skipSpaces(rest)) return table;
  table.root = json::parse(text.begin(), text.end(), nullptr, false);
  if (table.root.is_discarded()) return invalidInput("the JSON of its feature table is broken");
  return table;
}

base::Result<glm::dvec3> FeatureTable::center() const {
  // It stands in the JSON as numbers, or there as an offset into the binary part.
  const json& center = member(root, "RTC_CENTER");
  if (center.is_null()) return glm::dvec3(0.0);
  if (const auto numbers = gltf::numbers<glm::dvec3>(center)) return *numbers;
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, bytesOf("RTC_CENTER", sizeof(glm::vec3)));
  base::ByteReader reader(bytes);
  return glm::dvec3(reader.read<glm::vec3>());
}

base::Result<base::ByteView> FeatureTable::bytesOf(const char* semantic, std::uint64_t bytes) const {
  const std::uint64_t offset = gltf::integer(member(member(root, semantic), "byteOffset"), gltf::kMissing);
  if (offset > binary.size() || binary.size() - offset < bytes)
    return invalidInput(std::string(semantic) + " reaches past its feature table");
  return binary.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(bytes));
}

}  // namespace mesh::tiles
