#pragma once
// From Morton codes to small numbers: what finds a vertex by its place.
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace lod::build {

/// Open-addressed; codes are below 2^63.
class CodeMap {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  /// Room for `most` codes.
  explicit CodeMap(std::size_t most) {
    std::size_t slots = 16;
    shift_ = 60;
    for (; slots < 2 * most; slots *= 2) --shift_;
    keys_.assign(slots, kEmpty);
    values_.resize(slots);
  }
  /// The value of `code`, which becomes `next` when it is new; true when it is.
  std::pair<std::uint32_t, bool> insert(std::uint64_t code, std::uint32_t next) {
    const std::size_t slot = find(code);
    if (keys_[slot] == code) return {values_[slot], false};
    keys_[slot] = code;
    values_[slot] = next;
    return {next, true};
  }
  /// Its value, or kNone.
  std::uint32_t at(std::uint64_t code) const {
    const std::size_t slot = find(code);
    return keys_[slot] == code ? values_[slot] : kNone;
  }

 private:
  static constexpr std::uint64_t kEmpty = std::numeric_limits<std::uint64_t>::max();
  std::size_t find(std::uint64_t code) const {
    auto slot = static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> shift_);
    while (keys_[slot] != code && keys_[slot] != kEmpty) slot = slot + 1 < keys_.size() ? slot + 1 : 0;
    return slot;
  }
  std::vector<std::uint64_t> keys_;
  std::vector<std::uint32_t> values_;
  std::uint32_t shift_ = 0;
};

}  // namespace lod::build
