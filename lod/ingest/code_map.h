#pragma once
// From Morton codes to small numbers: what finds a vertex by its place.
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lod::ingest {

/// Numbers codes 0, 1, … in the order in which they come. Open-addressed, grows as it fills. Slots hold numbers alone:
/// a table of codes would be four times as long, and most of an insertion is waiting for it.
class CodeMap {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  /// So many codes ahead expect() pays.
  static constexpr std::size_t kAhead = 12;

  /// Room for `expected` codes before it has to grow.
  explicit CodeMap(std::size_t expected) {
    std::size_t slots = 64;
    while (slots < 2 * expected) slots *= 2;
    setSlots(slots);
    codes_.reserve(slots / 2);
  }
  /// The code's number; true when it is new.
  std::pair<std::uint32_t, bool> insert(std::uint64_t code) {
    const std::size_t slot = find(code);
    if (slots_[slot] != kNone) return {slots_[slot], false};
    const auto number = static_cast<std::uint32_t>(codes_.size());
    slots_[slot] = number;
    codes_.push_back(code);
    if (2 * codes_.size() > slots_.size()) grow();
    return {number, true};
  }
  /// Asks the memory for where `code` will be looked up soon.
  void expect(std::uint64_t code) const { __builtin_prefetch(&slots_[slotOf(code)]); }
  /// Its number, or kNone.
  std::uint32_t at(std::uint64_t code) const { return slots_[find(code)]; }
  /// By number. The map is of no more use.
  std::vector<std::uint64_t> takeCodes() { return std::move(codes_); }

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
  // Where it is, or would be.
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
