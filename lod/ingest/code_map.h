#pragma once
// A hash map that numbers Morton codes, by which builders find a vertex at its lattice point.
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lod::ingest {

/// Numbers codes 0, 1, … in the order in which they come. It is open-addressed and grows as it fills. Slots hold
/// numbers only: with codes the table would be four times as long, and an insertion spends most of its time
/// waiting for it.
class CodeMap {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  /// How many codes ahead callers call prefetch(). A choice: far enough for memory to answer, near enough for the slots
  /// to stay in the nearest cache until then.
  static constexpr std::size_t kPrefetchDistance = 12;

  /// Makes room for `expected` codes before it has to grow.
  explicit CodeMap(std::size_t expected) {
    std::size_t slots = 64;
    while (slots < 2 * expected) slots *= 2;
    setSlots(slots);
    codes_.reserve(slots / 2);
  }
  /// Returns the code's number, and whether it is new.
  std::pair<std::uint32_t, bool> insert(std::uint64_t code) {
    const std::size_t slot = find(code);
    if (slots_[slot] != kNone) return {slots_[slot], false};
    const auto number = static_cast<std::uint32_t>(codes_.size());
    slots_[slot] = number;
    codes_.push_back(code);
    if (2 * codes_.size() > slots_.size()) grow();
    return {number, true};
  }
  /// Prefetches the slot where `code` will soon be looked up.
  void prefetch(std::uint64_t code) const { __builtin_prefetch(&slots_[slotOf(code)]); }
  /// Returns the number of the code, or kNone.
  std::uint32_t at(std::uint64_t code) const { return slots_[find(code)]; }
  /// Moves out the codes by number; the map cannot be used any more.
  std::vector<std::uint64_t> releaseCodes() { return std::move(codes_); }

 private:
  void setSlots(std::size_t slots) {
    slots_.assign(slots, kNone);
    shift_ = 64;
    for (; slots > 1; slots /= 2) --shift_;
  }
  void grow() {
    setSlots(2 * slots_.size());
    for (std::uint32_t number = 0; number < codes_.size(); ++number) slots_[find(codes_[number])] = number;
  }
  std::size_t slotOf(std::uint64_t code) const {
    return static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> shift_);
  }
  // The slot of the code, or the free one where it would go.
  std::size_t find(std::uint64_t code) const {
    std::size_t slot = slotOf(code);
    while (slots_[slot] != kNone && codes_[slots_[slot]] != code) slot = slot + 1 < slots_.size() ? slot + 1 : 0;
    return slot;
  }
  std::vector<std::uint32_t> slots_;
  std::vector<std::uint64_t> codes_;
  std::uint32_t shift_ = 0;
};

}  // namespace lod::ingest
