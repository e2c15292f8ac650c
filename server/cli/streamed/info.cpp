#include "server/cli/streamed/info.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/file.h"
#include "base/format_text.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

std::uint64_t countIn(const nlohmann::json& object, const char* name) {
  return object[name].get<std::uint64_t>();
}

/// Reads header and table of a method's file; the functions are the method's.
template <class Header, class Row>
base::Result<FileTable<Header, Row>> readRows(const std::string& path, std::uint32_t header_bytes,
                                              base::Result<Header> (*read_header)(base::ByteView),
                                              base::Result<std::vector<Row>> (*read_table)(const Header&,
                                                                                           base::ByteView),
                                              base::Error (*damaged)(const std::string&)) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(path));
  base::Bytes front(std::min<std::uint64_t>(header_bytes, file.size()));
  LUMIGRID_TRY(file.readAt(0, front));
  const auto header = read_header(front);
  if (!header) return base::within(path, header.error());
  // Memory for the table is asked for only where the file is as long.
  if (header->file_bytes != file.size())
    return base::within(path, damaged("has " + std::to_string(file.size()) + " bytes, its header says " +
                                      std::to_string(header->file_bytes)));
  base::Bytes table(header->table_bytes);
  LUMIGRID_TRY(file.readAt(header_bytes, table));
  auto rows = read_table(*header, table);
  if (!rows) return base::within(path, rows.error());
  return FileTable<Header, Row>{*header, std::move(*rows)};
}

}  // namespace

base::Result<FileTable<lod::pmr::Header, lod::pmr::Leaf>> readUmbrellaTable(const std::string& path) {
  return readRows(path, lod::pmr::kHeaderBytes, lod::pmr::readHeader, lod::pmr::readTable, lod::pmr::damaged);
}
base::Result<FileTable<lod::hlod::Header, lod::hlod::Node>> readHlodTable(const std::string& path) {
  return readRows(path, lod::hlod::kHeaderBytes, lod::hlod::readHeader, lod::hlod::readTable, lod::hlod::damaged);
}

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
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, readUmbrellaTable(path));
  LevelCounts points{}, triangles{};
  for (const lod::pmr::Leaf& leaf : file.rows)
    for (std::uint32_t level = 0; level < lod::pmr::kLevels; ++level) {
      points[level] += leaf.pointsAt(level);
      triangles[level] += leaf.levels[level].triangles;
    }
  return umbrellasJson(file.header, points, triangles);
}

std::string describeUmbrellas(const nlohmann::json& umbrellas) {
  const auto count = [](const nlohmann::json& object, const char* name) { return formatCount(countIn(object, name)); };
  std::string text = base::formatText(
      "%s points in %s leaves; %s, %.2f bytes a point; normals %s", count(umbrellas, "points").c_str(),
      count(umbrellas, "leaves").c_str(), formatBytes(countIn(umbrellas, "bytes")).c_str(),
      umbrellas["bytes_per_point"].get<double>(), umbrellas["oriented"].get<bool>() ? "point outside" : "have no side");
  int number = 0;
  for (const nlohmann::json& level : umbrellas["levels"])
    text += base::formatText("\n  level %2d: %12s points %12s triangles", number++, count(level, "points").c_str(),
                             count(level, "triangles").c_str());
  return text;
}

// ---- Octrees of triangles and points

namespace {

/// Adds up the nodes of each depth: those of one lie side by side, and are the children of those of the one above.
std::vector<lod::hlod::builder::LevelSummary> levelsOf(std::span<const lod::hlod::Node> nodes) {
  std::vector<lod::hlod::builder::LevelSummary> levels;
  for (std::size_t begin = 0, end = 1; begin < end && end <= nodes.size();) {
    lod::hlod::builder::LevelSummary level;
    std::size_t next_end = end;
    for (const lod::hlod::Node& node : nodes.subspan(begin, end - begin)) {
      ++level.nodes;
      level.triangles += node.triangles;
      level.points += node.points;
      level.caster_triangles += node.isLeaf() ? node.triangles : node.caster_triangles;
      level.picture_bytes += node.picture.bytes;
      level.caster_bytes += node.caster.bytes;
      level.largest_error = std::max(level.largest_error, node.error);
      next_end += node.children;
    }
    levels.push_back(level);
    begin = std::exchange(end, next_end);
  }
  return levels;
}

}  // namespace

nlohmann::json hlodJson(const lod::hlod::Header& header, std::span<const lod::hlod::builder::LevelSummary> levels) {
  nlohmann::json depths = nlohmann::json::array();
  for (const lod::hlod::builder::LevelSummary& level : levels)
    depths.push_back({{"nodes", level.nodes},
                      {"triangles", level.triangles},
                      {"points", level.points},
                      {"caster_triangles", level.caster_triangles},
                      {"picture_bytes", level.picture_bytes},
                      {"caster_bytes", level.caster_bytes},
                      {"largest_error", level.largest_error}});
  const auto triangles = static_cast<double>(std::max<std::uint64_t>(header.source_triangles, 1));
  return {{"bytes", header.file_bytes},
          {"nodes", header.nodes},
          {"triangles", header.source_triangles},
          {"bytes_per_triangle", static_cast<double>(header.file_bytes) / triangles},
          {"levels", depths}};
}

base::Result<nlohmann::json> readHlodJson(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, readHlodTable(path));
  return hlodJson(file.header, levelsOf(file.rows));
}

std::string describeHlod(const nlohmann::json& hlod) {
  std::string text =
      base::formatText("%s nodes of %s triangles; %s, %.2f bytes a triangle",
                       formatCount(countIn(hlod, "nodes")).c_str(), formatCount(countIn(hlod, "triangles")).c_str(),
                       formatBytes(countIn(hlod, "bytes")).c_str(), hlod["bytes_per_triangle"].get<double>());
  int number = 0;
  for (const nlohmann::json& level : hlod["levels"])
    text += base::formatText("\n  level %2d: %7s nodes %12s triangles %12s points, %s, nowhere off by more than %.3g",
                             number++, formatCount(countIn(level, "nodes")).c_str(),
                             formatCount(countIn(level, "triangles")).c_str(),
                             formatCount(countIn(level, "points")).c_str(),
                             formatBytes(countIn(level, "picture_bytes") + countIn(level, "caster_bytes")).c_str(),
                             level["largest_error"].get<double>());
  return text;
}

}  // namespace server::cli
