#pragma once
// Describes a tree of splats, for `build` and `info`.
#include <nlohmann/json.hpp>
#include <string>

#include "lod/qsplat/format.h"

namespace server::cli {

/// Counts, bytes per leaf, the pointers' share of the file, and children per inner node.
nlohmann::json splatsJson(const lod::qsplat::Header& header);
/// The same as one line of text.
std::string describeSplats(const nlohmann::json& splats);

}  // namespace server::cli
