#pragma once
// What a tree of splats is like, for `build` and `info`.
#include <nlohmann/json.hpp>
#include <string>

#include "lod/qsplat/format.h"

namespace server::cli {

/// Counts, bytes per leaf, the pointers' share of the file, children per inner node.
nlohmann::json splatsJson(const lod::qsplat::Header& header);
/// The same on one line.
std::string describeSplats(const nlohmann::json& splats);

}  // namespace server::cli
