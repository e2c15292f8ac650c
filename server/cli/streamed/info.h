#pragma once
// Describes the files that viewers stream by ranges, for `build` and `info`: qsplat.lgq, pmr.lgm and hlod.lgh.
#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/hlod/builder/build.h"
#include "lod/hlod/format.h"
#include "lod/pmr/format.h"
#include "lod/qsplat/format.h"

namespace server::cli {

/// Counts, bytes per leaf, the pointers' share of the file, and children per inner node.
nlohmann::json splatsJson(const lod::qsplat::Header& header);
/// The same as one line of text.
std::string describeSplats(const nlohmann::json& splats);

/// The front of a method's file: its header, and the rows of its table.
template <class Header, class Row>
struct FileTable {
  Header header;
  std::vector<Row> rows;
};
/// Errors name the file: those of opening it, and of lod::pmr::readHeader and readTable.
base::Result<FileTable<lod::pmr::Header, lod::pmr::Leaf>> readUmbrellaTable(const std::string& path);
/// The same with those of lod::hlod.
base::Result<FileTable<lod::hlod::Header, lod::hlod::Node>> readHlodTable(const std::string& path);

/// Points or triangles at each level of a pmr.lgm, the finest first.
using LevelCounts = std::array<std::uint64_t, lod::pmr::kLevels>;

/// Counts, bytes per point, and points and triangles at each level.
nlohmann::json umbrellasJson(const lod::pmr::Header& header, const LevelCounts& points, const LevelCounts& triangles);
/// The same for a file. Errors: those of readUmbrellaTable().
base::Result<nlohmann::json> readUmbrellasJson(const std::string& path);
/// One line, and one for each level.
std::string describeUmbrellas(const nlohmann::json& umbrellas);

/// Counts, bytes per triangle of the source, and nodes, triangles, points, bytes and largest error by depth.
nlohmann::json hlodJson(const lod::hlod::Header& header, std::span<const lod::hlod::builder::LevelSummary> levels);
/// The same for a file. Errors: those of readHlodTable().
base::Result<nlohmann::json> readHlodJson(const std::string& path);
/// One line, and one for each level.
std::string describeHlod(const nlohmann::json& hlod);

}  // namespace server::cli
