#pragma once
// Edges by the cost of their collapse, cheapest first.
#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <utility>
#include <vector>

namespace lod::patch::builder {

/// No edge comes in that is cheaper than the last one taken out, so only those next in turn need to be in order: they
/// lie in a heap of four children to a node. The others wait unordered in buckets of costs an eighth of an octave wide,
/// and most never leave them; a bucket is a chain of blocks.
///
/// In the heap, cost and edge number make one 64-bit key, so that a comparison is one instruction and ties go by
/// number: the bits of floats that are not negative sort as the floats do.
class EdgeQueue {
 public:
  struct Entry {
    float cost = 0.0F;
    std::uint32_t edge = 0;
  };
  /// Empties the queue and makes room for about so many edges.
  void reset(std::size_t edges) {
    keys_.clear();
    open_ = 0;
    newest_.assign(kBuckets, kNone);
    blocks_.clear();
    blocks_.reserve(edges / kBlockEntries + 128);
    free_ = kNone;
  }
  void push(float cost, std::uint32_t edge) {
    const std::uint32_t bucket = bits(cost) >> kBucketShift;
    if (bucket < open_) return pushKey(keyOf(cost, edge));
    std::uint32_t& newest = newest_[bucket];
    if (newest == kNone || blocks_[newest].count == kBlockEntries) newest = blockBefore(newest);
    Block& block = blocks_[newest];
    block.entries[block.count++] = {cost, edge};
  }
  /// Hands out the cheapest bucket, latest edges first. These edges and all as cheap belong in the heap from now on.
  /// False if no edge waits.
  bool openBucket(std::vector<Entry>& entries) {
    entries.clear();
    while (open_ < kBuckets && newest_[open_] == kNone) ++open_;
    if (open_ == kBuckets) return false;
    for (std::uint32_t b = newest_[open_++]; b != kNone;) {
      Block& block = blocks_[b];
      const auto end = std::make_reverse_iterator(block.entries.begin());
      entries.insert(entries.end(), end - block.count, end);
      const std::uint32_t next = std::exchange(block.older, free_);
      free_ = std::exchange(b, next);
    }
    return true;
  }

  /// Edges in the heap; the functions below look at the heap alone.
  std::size_t size() const { return keys_.size(); }
  float lowest() const { return costOf(keys_.front()); }
  Entry top() const { return {costOf(keys_.front()), static_cast<std::uint32_t>(keys_.front())}; }
  void pop() {
    const std::uint64_t last = keys_.back();
    keys_.pop_back();
    if (!keys_.empty()) sink(0, last);
  }
  /// The entry next to the lowest; of infinite cost when there is none.
  Entry second() const {
    if (keys_.size() == 1) return {std::numeric_limits<float>::infinity(), static_cast<std::uint32_t>(keys_.front())};
    const std::uint64_t key =
        *std::min_element(keys_.begin() + 1, keys_.begin() + std::min<std::ptrdiff_t>(5, std::ssize(keys_)));
    return {costOf(key), static_cast<std::uint32_t>(key)};
  }
  /// Gives the lowest entry a higher cost.
  void raiseTop(float cost) {
    const auto edge = static_cast<std::uint32_t>(keys_.front());
    if (bits(cost) >> kBucketShift < open_) return sink(0, keyOf(cost, edge));
    pop();
    push(cost, edge);
  }

 private:
  static constexpr std::uint32_t kBucketShift = 20;  // keeps a float's exponent and three bits of its fraction
  static constexpr std::uint32_t kBuckets = 1U << (31 - kBucketShift);
  static constexpr std::uint32_t kNone = ~0U;
  static constexpr std::size_t kBlockEntries = 15;  // a block takes two cache lines
  struct Block {
    std::uint32_t count = 0;
    std::uint32_t older = kNone;  // the bucket's next older block, or the next free block
    std::array<Entry, kBlockEntries> entries;
  };

  std::uint32_t blockBefore(std::uint32_t older) {
    std::uint32_t block = free_;
    if (block != kNone) {
      free_ = blocks_[block].older;
    } else {
      block = static_cast<std::uint32_t>(blocks_.size());
      blocks_.emplace_back();
    }
    blocks_[block].count = 0;
    blocks_[block].older = older;
    return block;
  }
  static std::uint32_t bits(float cost) { return std::bit_cast<std::uint32_t>(std::max(0.0F, cost)); }
  static std::uint64_t keyOf(float cost, std::uint32_t edge) { return std::uint64_t{bits(cost)} << 32 | edge; }
  static float costOf(std::uint64_t key) { return std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32)); }
  void pushKey(std::uint64_t key) {
    std::size_t i = keys_.size();
    keys_.push_back(key);
    for (; i > 0 && key < keys_[(i - 1) / 4]; i = (i - 1) / 4) keys_[i] = keys_[(i - 1) / 4];
    keys_[i] = key;
  }
  void sink(std::size_t i, std::uint64_t key) {
    const std::size_t size = keys_.size();
    for (std::size_t child = 4 * i + 1; child < size; child = 4 * i + 1) {
      const std::size_t end = std::min(child + 4, size);
      std::size_t min_child = child;
      std::uint64_t min_key = keys_[child];
      for (std::size_t c = child + 1; c < end; ++c) {
        const bool less = keys_[c] < min_key;
        min_child = less ? c : min_child;
        min_key = less ? keys_[c] : min_key;
      }
      if (key <= min_key) break;
      keys_[i] = min_key;
      i = min_child;
    }
    keys_[i] = key;
  }

  std::vector<std::uint64_t> keys_;
  std::uint32_t open_ = 0;             // edges of the buckets below are in the heap
  std::vector<std::uint32_t> newest_;  // per bucket: its block that is not full
  std::vector<Block> blocks_;
  std::uint32_t free_ = kNone;
};

}  // namespace lod::patch::builder
