#include "server/cli/streamed_info.h"

#include <algorithm>

#include "base/file.h"
#include "base/format_text.h"
#include "server/cli/console.h"

namespace server::cli {

nlohmann::json splatsJson(const lod::qsplat::Header& header) {
  const auto bytes = static_cast<double>(header.file_bytes);
  const auto stored = static_cast<double>(header.storedBytes());
  const auto inner = static_cast<double>(std::max<std::uint64_t>(header.groups - 1, 1));
  return {{"bytes", header.storedBytes()},
          {"coded", header.coded()},
          {"plain_bytes", header.file_bytes},
          {"nodes", header.nodes},
          {"leaves", header.leaves},
          {"levels", header.levels},
          {"node_bytes", header.nodeBytes()},
          {"bytes_per_leaf", stored / static_cast<double>(header.leaves)},
          {"pointer_share", static_cast<double>(header.pointers * header.pointerBytes()) / bytes},
          {"branching", static_cast<double>(header.nodes - 1) / inner}};
}

std::string describeSplats(const nlohmann::json& splats) {
  const auto count = [&](const char* name) { return formatCount(splats[name].get<std::uint64_t>()); };
  const bool coded = splats["coded"].get<bool>();
  return base::formatText(
      "%s leaves in %s nodes of %u bytes, %u levels; %s%s, %.2f bytes a leaf, %.1f %% of %s pointers, %.2f "
      "children a node",
      count("leaves").c_str(), count("nodes").c_str(), splats["node_bytes"].get<unsigned>(),
      splats["levels"].get<unsigned>(), formatBytes(splats["bytes"].get<std::uint64_t>()).c_str(),
      coded ? (" coded, " + formatBytes(splats["plain_bytes"].get<std::uint64_t>()) + " plain").c_str() : "",
      splats["bytes_per_leaf"].get<double>(), 100.0 * splats["pointer_share"].get<double>(),
      coded ? "the plain form" : "it", splats["branching"].get<double>());
}

nlohmann::json umbrellasJson(const lod::pmr::Header& header, const LevelCounts& points, const LevelCounts& triangles) {
  nlohmann::json levels = nlohmann::json::array();
  for (std::size_t level = 0; level < points.size(); ++level)
    levels.push_back({{"points", points[level]}, {"triangles", triangles[level]}});
  const auto all = static_cast<double>(std::max<std::uint64_t>(header.points, 1));
  return {{"bytes", header.file_bytes},  {"points", header.points},
          {"leaves", header.leaves},     {"bytes_per_point", static_cast<double>(header.file_bytes) / all},
          {"oriented", header.oriented}, {"levels", levels}};
}

base::Result<nlohmann::json> readUmbrellasJson(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(path));
  base::Bytes front(std::min<std::uint64_t>(lod::pmr::kHeaderBytes, file.size()));
  LUMIGRID_TRY(file.readAt(0, front));
  const auto header = lod::pmr::readHeader(front);
  if (!header) return base::within(path, header.error());
  if (header->file_bytes != file.size())
    return base::within(path, lod::pmr::damaged("has " + std::to_string(file.size()) + " bytes, its header says " +
                                                std::to_string(header->file_bytes)));
  base::Bytes table(header->table_bytes);
  LUMIGRID_TRY(file.readAt(lod::pmr::kHeaderBytes, table));
  const auto leaves = lod::pmr::readTable(*header, table);
  if (!leaves) return base::within(path, leaves.error());
  LevelCounts points{}, triangles{};
  for (const lod::pmr::Leaf& leaf : *leaves)
    for (std::uint32_t level = 0; level < lod::pmr::kLevels; ++level) {
      points[level] += leaf.pointsAt(level);
      triangles[level] += leaf.levels[level].triangles;
    }
  return umbrellasJson(*header, points, triangles);
}

std::string describeUmbrellas(const nlohmann::json& umbrellas) {
  const auto count = [](const nlohmann::json& object, const char* name) {
    return formatCount(object[name].get<std::uint64_t>());
  };
  std::string text = base::formatText(
      "%s points in %s leaves; %s, %.2f bytes a point; normals %s", count(umbrellas, "points").c_str(),
      count(umbrellas, "leaves").c_str(), formatBytes(umbrellas["bytes"].get<std::uint64_t>()).c_str(),
      umbrellas["bytes_per_point"].get<double>(), umbrellas["oriented"].get<bool>() ? "point outside" : "have no side");
  int number = 0;
  for (const nlohmann::json& level : umbrellas["levels"])
    text += base::formatText("\n  level %2d: %12s points %12s triangles", number++, count(level, "points").c_str(),
                             count(level, "triangles").c_str());
  return text;
}

}  // namespace server::cli
