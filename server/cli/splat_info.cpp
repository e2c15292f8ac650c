#include "server/cli/splat_info.h"

#include <algorithm>

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

}  // namespace server::cli
