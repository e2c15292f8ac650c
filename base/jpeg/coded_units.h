#pragma once
// The units of a baseline JPEG as they are coded, with an index of where each begins. Private to base/jpeg.
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/jpeg/huffman.h"
#include "base/jpeg/quarter.h"

namespace base::jpeg {

/// 8 x 8 quantized coefficients, row by row.
using Block = std::array<std::int16_t, 64>;

/// Where the coefficients lie in a block, in the order in which they are coded (T.81, figure A.6).
inline constexpr std::array<std::uint8_t, 64> kZigzag = [] {
  std::array<std::uint8_t, 64> order{};
  int x = 0, y = 0;
  for (std::uint8_t& place : order) {
    place = static_cast<std::uint8_t>(8 * y + x);
    const bool up = (x + y) % 2 == 0;
    if (up && x == 7) {
      ++y;
    } else if (up && y == 0) {
      ++x;
    } else if (!up && y == 7) {
      ++x;
    } else if (!up && x == 0) {
      ++y;
    } else {
      x += up ? 1 : -1, y += up ? -1 : 1;
    }
  }
  return order;
}();

/// The codes of a plane's coefficients.
struct PlaneCode {
  std::shared_ptr<const HuffmanTable> means, others;
};

/// How the units are coded. Planes but the first have one block in each.
struct UnitLayout {
  std::size_t across = 0, down = 0;  ///< units of the picture
  std::size_t first_blocks = 1;      ///< blocks of the first plane in a unit: 1, 2 or 4
  std::vector<PlaneCode> planes;     ///< their tables have a code for everything
  std::size_t blocks() const { return first_blocks + planes.size() - 1; }  ///< in a unit; at most 6
};

/// Reading from several threads is safe.
class CodedUnits {
 public:
  static constexpr std::size_t kMaxBlocks = 6;  ///< in a unit

  /// Finds the units in the coded bytes, which end with a marker, or takes their places from `index`, if that is of
  /// these bytes. Nothing where these are broken, or have restarts or coefficients that no picture of 8 bits has, or
  /// where this would take more than `max_bytes` of memory.
  static std::optional<CodedUnits> read(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes,
                                        ByteView index = {});
  /// The same, and makes the picture at a quarter of its size in the same pass.
  static std::optional<CodedUnits> readQuarter(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes,
                                               const QuarterRows& quarter);
  /// Where the units lie, for read(): u32 CRC-32C of the coded bytes, u16 length of each unit, bits, and i16 means of
  /// its blocks.
  Bytes index() const;

  /// The coefficient of a block's mean. `block`: 0 <= block < blocks(), by planes; `unit` row by row.
  std::int16_t mean(std::size_t unit, std::size_t block) const { return means_[unit * layout_.blocks() + block]; }
  /// Decodes those blocks of a unit for which there is a place.
  void decode(std::size_t unit, std::span<Block* const> blocks) const;

  /// Appends `count` units coded to `out`. source(i, blocks) returns which unit of this JPEG is copied, or writes the
  /// unit's blocks to `blocks`: means of -1024 to 1023, others of -1023 to 1023.
  using Source = std::function<std::optional<std::size_t>(std::size_t i, Block* blocks)>;
  void encode(std::size_t count, const Source& source, Bytes& out) const;

 private:
  class Encoder;
  explicit CodedUnits(const UnitLayout& layout) : layout_(layout) {}
  static std::optional<CodedUnits> begin(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes);
  bool findUnits();
  bool takeIndex(ByteView index);
  bool findQuarter(const QuarterRows& quarter);
  template <class Others>
  bool walk(const Others& others);
  std::size_t planeOf(std::size_t block) const {
    return block < layout_.first_blocks ? 0 : block - layout_.first_blocks + 1;
  }

  UnitLayout layout_;
  std::unique_ptr<std::uint8_t[]> bytes_;  // without stuffed ones, and kMargin more
  std::size_t coded_ = 0;                  // bytes
  std::vector<std::uint32_t> starts_;      // of units, bits; and the end of the last
  std::vector<std::int16_t> means_;        // of units' blocks
};

}  // namespace base::jpeg
