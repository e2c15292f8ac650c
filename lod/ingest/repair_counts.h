#pragma once
// The repairs that a build makes to its source, counted for the user.
#include <cstdint>
#include <map>
#include <string>

namespace lod::ingest {

/// How often each repair was made. Names are stable, since `info --json` shows them: "welded_vertices",
/// "degenerate_triangles", "duplicate_triangles", "lattice_collapsed_triangles", "flipped_triangles",
/// "non_orientable_parts", "unreferenced_vertices".
struct RepairCounts {
  std::map<std::string, std::uint64_t> counts;

  void add(const std::string& repair, std::uint64_t times) {
    if (times > 0) counts[repair] += times;
  }
};

}  // namespace lod::ingest
