#pragma once
// Counts bytes that were transferred more than once.
#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace support {

/// Ranges [first, end) by the object that they belong to.
using ByteRanges = std::map<std::string, std::vector<std::pair<std::uint64_t, std::uint64_t>>>;

/// Bytes that lie in more than one range, counted each time but the first.
inline std::uint64_t bytesRepeated(const ByteRanges& ranges) {
  std::uint64_t repeated = 0;
  for (const auto& [name, list] : ranges) {
    auto sorted = list;
    std::sort(sorted.begin(), sorted.end());
    std::uint64_t covered = 0;
    for (const auto& [first, end] : sorted) {
      if (first < covered) repeated += std::min(covered, end) - first;
      covered = std::max(covered, end);
    }
  }
  return repeated;
}

}  // namespace support
