#pragma once
// From Morton codes to small numbers: what finds a vertex by its place.
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lod::build {

/// Open-addressed, grows as it fills; codes are below 2^63.
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
  }
  /// The value of `code`, which becomes `next` when it is new; true when it is.
  std::pair<std::uint32_t, bool> insert(std::uint64_t code, std::uint32_t next) {
    std::size_t slot = find(code);
    if (slots_[slot].code == code) return {slots_[slot].value, false};
    if (2 * ++size_ > slots_.size()) {
      grow();
      slot = find(code);
    }
    slots_[slot] = {code, next};
    return {next, true};
  }
  /// Asks the memory for where `code` will be looked up soon: most of an insertion is waiting for it.
  void expect(std::uint64_t code) const { __builtin_prefetch(&slots_[slotOf(code)]); }
  /// Its value, or kNone.
  std::uint32_t at(std::uint64_t code) const {
    const Slot& slot = slots_[find(code)];
    return slot.code == code ? slot.value : kNone;
  }

 private:
  static constexpr std::uint64_t kEmpty = std::numeric_limits<std::uint64_t>::max();
  struct Slot {
    std::uint64_t code = kEmpty;
    std::uint32_t value = 0;
  };
  void setSlots(std::size_t slots) {
    slots_.assign(slots, {});
    shift_ = 64;
    for (; slots > 1; slots /= 2) --shift_;
  }
  void grow() {
    std::vector<Slot> old = std::move(slots_);
    setSlots(2 * old.size());
    for (const Slot& slot : old)
      if (slot.code != kEmpty) slots_[find(slot.code)] = slot;
  }
  std::size_t slotOf(std::uint64_t code) const {
    return static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> shift_);
  }
  std::size_t find(std::uint64_t code) const {
    std::size_t slot = slotOf(code);
    while (slots_[slot].code != code && slots_[slot].code != kEmpty) slot = slot + 1 < slots_.size() ? slot + 1 : 0;
    return slot;
  }
  std::vector<Slot> slots_;
  std::size_t size_ = 0;
  std::uint32_t shift_ = 0;
};

}  // namespace lod::build
