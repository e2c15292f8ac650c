#pragma once
// Finds items near a place whose sizes differ by orders of magnitude, such as the edges of a scan's border: items of
// each power of two of size lie in a grid of their own, so that fine ones do not crowd the cells of coarse ones.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lod::ingest {

class LevelGrid {
 public:
  /// The power of two of a size; sizes below 1 count as 1.
  static int levelOf(float size) { return std::ilogb(std::max(size, 1.0F)); }

  /// Items at these lattice points, with these sizes. Numbers are their places in both.
  LevelGrid(std::span<const glm::ivec3> points, std::span<const float> sizes) {
    items_.reserve(points.size());
    for (std::uint32_t i = 0; i < points.size(); ++i) {
      const int level = levelOf(sizes[i]);
      items_.push_back({keyOf(level, points[i] >> (level + kCellShift)), i});
      levels_ |= 1U << level;
    }
    std::sort(items_.begin(), items_.end(),
              [](const Item& a, const Item& b) { return a.key != b.key ? a.key < b.key : a.number < b.number; });
    std::size_t slots = 64;
    while (slots < 2 * items_.size()) slots *= 2;
    slots_.assign(slots, kEmpty);
    shift_ = 64;
    for (; slots > 1; slots /= 2) --shift_;
    for (std::uint32_t i = 0; i < items_.size(); ++i)
      if (i == 0 || items_[i].key != items_[i - 1].key) slots_[slotOf(items_[i].key)] = i;
  }

  /// Calls body(number) for the items of `least_level` and above whose points lie in the cells within
  /// radius(longest) of the point on each axis; `longest` bounds the size of the items asked for.
  template <class Radius, class Body>
  void near(const glm::ivec3& point, int least_level, Radius&& radius, Body&& body) const {
    for (std::uint32_t levels = levels_ >> least_level << least_level; levels != 0; levels &= levels - 1) {
      const int level = __builtin_ctz(levels);
      const auto reach = static_cast<int>(std::ceil(radius(std::ldexp(1.0F, level + 1))));
      const glm::ivec3 low = glm::max(point - reach, glm::ivec3(0)) >> (level + kCellShift);
      const glm::ivec3 high = (point + reach) >> (level + kCellShift);
      for (int z = low.z; z <= high.z; ++z)
        for (int y = low.y; y <= high.y; ++y)
          for (int x = low.x; x <= high.x; ++x) {
            const std::uint64_t key = keyOf(level, {x, y, z});
            for (std::uint32_t i = slots_[slotOf(key)]; i < items_.size() && items_[i].key == key; ++i)
              body(items_[i].number);
          }
    }
  }

 private:
  static constexpr std::uint32_t kEmpty = 0xFFFFFFFFU;
  static constexpr int kCellShift = 1;  // a cell is one to two times as wide as its items

  struct Item {
    std::uint64_t key = 0;
    std::uint32_t number = 0;
  };
  // Coordinates have 21 bits before they are shifted, so that 19 are left.
  static std::uint64_t keyOf(int level, const glm::ivec3& cell) {
    return static_cast<std::uint64_t>(level) << 57 | static_cast<std::uint64_t>(cell.x) << 38 |
           static_cast<std::uint64_t>(cell.y) << 19 | static_cast<std::uint64_t>(cell.z);
  }
  // The slot of the key, or the free one where it would go.
  std::size_t slotOf(std::uint64_t key) const {
    auto slot = static_cast<std::size_t>((key * 0x9E3779B97F4A7C15ULL) >> shift_);
    while (slots_[slot] != kEmpty && items_[slots_[slot]].key != key) slot = slot + 1 < slots_.size() ? slot + 1 : 0;
    return slot;
  }

  std::vector<Item> items_;
  std::vector<std::uint32_t> slots_;  // by hash of the key: the first item of the cell
  std::uint32_t levels_ = 0;          // a bit for each that has items
  int shift_ = 64;
};

}  // namespace lod::ingest
