#pragma once
// Disjoint sets of the numbers below some count (union-find with path halving), such as the connected parts of a mesh.
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace lod::ingest {

class DisjointSets {
 public:
  /// Each number is a set of its own at first.
  explicit DisjointSets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0U); }

  /// The least number of the set.
  std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::uint32_t a, std::uint32_t b) {
    a = find(a), b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }
  /// The least number of each number's set.
  std::vector<std::uint32_t> roots() && {
    for (std::uint32_t i = 0; i < parent_.size(); ++i) parent_[i] = find(i);
    return std::move(parent_);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace lod::ingest
