#pragma once
// Writes planes of residuals (residuals.h).
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"

namespace lod::patch::codec {

class ResidualWriter {
 public:
  /// For planes of at most `count` numbers, a multiple of kGroup.
  explicit ResidualWriter(std::size_t count);

  /// Appends the numbers as one plane. `numbers`: zigzag() of the residuals, in whole groups.
  void write(base::ByteWriter& out, std::span<const std::uint32_t> numbers);

 private:
  std::uint32_t chooseWidths(std::span<const std::uint32_t> numbers, std::size_t groups);
  void storeUnary(const std::uint32_t* group, std::uint32_t width, std::size_t& bit);
  void writeWidths(base::ByteWriter& out, std::size_t groups, std::uint32_t min_width) const;

  std::vector<std::uint8_t> widths_;
  base::Bytes low_;
  base::Bytes unary_;
};

}  // namespace lod::patch::codec
