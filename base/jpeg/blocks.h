#pragma once
// The blocks of a JPEG: its quantized DCT coefficients (ITU-T T.81, annexes A and F), which can be moved to another
// JPEG of the same tables without decoding them, so that nothing is lost.
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>

#include "base/bytes.h"
#include "base/error.h"

namespace base {

/// 8 x 8 quantized coefficients, row by row from the one of the mean, frequencies growing to the right and downwards.
using JpegBlock = std::array<std::int16_t, 64>;

/// One of a JPEG's planes: brightness, or one of the two of colour.
struct JpegPlane {
  int across = 1, down = 1;               ///< blocks of the plane in a unit (below): 1 or 2
  int wide = 0, high = 0;                 ///< blocks of the plane that hold pixels of the picture
  std::array<std::uint16_t, 64> quant{};  ///< a coefficient's unit, in the order of JpegBlock; never 0
};

/// A JPEG's blocks in memory. Pixels are coded in *units* (the standard's MCU) of 8 or 16 pixels a side, each of which
/// has across x down blocks of every plane. Reading from several threads is safe.
class JpegBlocks {
 public:
  /// Reads baseline and progressive JPEGs of 8 bits a sample, with one plane (grey) or three (YCbCr), the first of
  /// which has at most 2 x 2 blocks a unit and the others one. Errors: kUnsupported for all others, for a side over
  /// 16384, and where the blocks would take more than `max_bytes` of memory; kInvalidInput for broken data, also where
  /// libjpeg would only warn; kUnsupported also for means of blocks that no picture has.
  static Result<JpegBlocks> read(ByteView jpeg, std::uint64_t max_bytes);
  JpegBlocks(JpegBlocks&&) noexcept;
  JpegBlocks& operator=(JpegBlocks&&) noexcept;
  ~JpegBlocks();

  int width() const;   ///< pixels
  int height() const;  ///< pixels
  int unitWidth() const { return 8 * plane(0).across; }
  int unitHeight() const { return 8 * plane(0).down; }
  int planes() const;  ///< 1 or 3
  const JpegPlane& plane(int number) const;
  /// The plane's block x of row y, 0 <= x < wide and 0 <= y < high; the row's others follow it.
  const JpegBlock* block(int plane, int x, int y) const;

  /// Writes a baseline JPEG of `width` x `height` pixels, 1 to 65500, with planes and quantization like this one.
  /// fill(plane, y, row) writes the plane's blocks of row y, as many as hold pixels: means of -1024 to 1023, others of
  /// -1023 to 1023. Huffman tables are those of this JPEG where they have a code for everything, as the standard's
  /// have, else ones made for what was filled in, which takes three times as long. Errors: kInvalidInput where libjpeg
  /// refuses.
  Result<Bytes> encode(int width, int height, const std::function<void(int plane, int y, JpegBlock* row)>& fill) const;

 private:
  class Reader;
  explicit JpegBlocks(std::unique_ptr<Reader> reader);
  std::unique_ptr<Reader> reader_;
};

}  // namespace base
