#pragma once
// A radix sort by Morton codes, and the code of a triangle.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "lod/morton.h"

namespace lod::ingest {

using lod::kMaxLatticeBits;
using lod::mortonCode;
using lod::mortonPoint;

/// The median of its vertices' codes is the code by which a triangle is assigned to a bucket and a voxel.
inline std::uint64_t medianCode(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

struct KeyedIndex {
  std::uint64_t key = 0;
  std::uint32_t index = 0;
};
/// Sorts stably by the lowest `key_bits` bits of the key.
void radixSort(std::vector<KeyedIndex>& items, std::uint32_t key_bits);

}  // namespace lod::ingest
