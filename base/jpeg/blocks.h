#pragma once
// The blocks of a JPEG: its quantized DCT coefficients (ITU-T T.81, annexes A and F), which can be moved to another
// JPEG of the same tables without decoding them, so that nothing is lost.
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace base {

/// 8 x 8 quantized coefficients, row by row from the one of the mean, frequencies growing to the right and downwards.
using JpegBlock = std::array<std::int16_t, 64>;

/// One of a JPEG's planes: brightness, or one of the two of colour.
struct JpegPlane {
  int across = 1, down = 1;               ///< blocks of the plane in a unit (below): 1 or 2
  int wide = 0, high = 0;                 ///< blocks of the plane that hold pixels of the picture
  std::array<std::uint16_t, 64> quant{};  ///< a coefficient's unit, in the order of JpegBlock; never 0
};

/// A JPEG's blocks. Pixels are coded in *units* (the standard's MCU) of 8 or 16 pixels a side, each of which has
/// across x down blocks of every plane. Reading from several threads is safe.
///
/// Most JPEGs stay coded in memory, with an index of where each unit begins; units that follow each other are then
/// copied as bits. Those that are progressive, have restarts or tables without a code for everything are decoded.
class JpegBlocks {
 public:
  /// Reads baseline and progressive JPEGs of 8 bits a sample, with one plane (grey) or three (YCbCr), the first of
  /// which has at most 2 x 2 blocks a unit and the others one. Errors: kUnsupported for all others, for a side over
  /// 16384, and where they would take more than `max_bytes` of memory; kInvalidInput for broken data, also where
  /// libjpeg would only warn; kUnsupported also for means of blocks that no picture has.
  /// With what readQuarter() says of `units` of the same bytes they are not looked for again.
  static Result<JpegBlocks> read(ByteView jpeg, std::uint64_t max_bytes, ByteView units = {});
  /// A picture at a quarter of its size, rounded down but at least 1: each pixel the mean of 4 x 4, or of those there
  /// are with the padding that the JPEG has beside them.
  struct Quarter {
    Image picture;  ///< RGB
    Bytes units;    ///< for read(); some 9 % of the JPEG's bytes
  };
  /// Reads both in one pass over the coded bytes, of JPEGs that stay coded (above). Nothing for others, for broken ones
  /// and where more than `max_bytes` of memory would be taken.
  static std::optional<Quarter> readQuarter(ByteView jpeg, std::uint64_t max_bytes);
  JpegBlocks(JpegBlocks&&) noexcept;
  JpegBlocks& operator=(JpegBlocks&&) noexcept;
  ~JpegBlocks();

  int width() const;   ///< pixels
  int height() const;  ///< pixels
  int unitWidth() const { return 8 * plane(0).across; }
  int unitHeight() const { return 8 * plane(0).down; }
  int planes() const;  ///< 1 or 3
  const JpegPlane& plane(int number) const;
  /// The plane's block x of row y, 0 <= x < wide and 0 <= y < high.
  JpegBlock block(int plane, int x, int y) const;
  /// block(plane, x, y)[0], which is faster.
  int mean(int plane, int x, int y) const;
  /// The block of each plane that holds a pixel of the picture, at once.
  void blocksAt(int x, int y, std::array<JpegBlock, 3>& blocks) const;
  static constexpr std::size_t kMostInUnit = 6;  ///< blocks
  /// All blocks of a unit, by planes and row by row. (x, y) counts units; those that reach beyond the picture have
  /// blocks without meaning.
  void unitBlocks(int x, int y, std::array<JpegBlock, kMostInUnit>& blocks) const;

  /// unit(x, y, blocks) returns which unit of this JPEG is unit (x, y) of another one, no part of it beyond this
  /// picture's edges; or it writes the unit's blocks to `blocks`, by planes and row by row, means of -1024 to 1023 and
  /// others of -1023 to 1023.
  using Units = std::function<std::optional<std::array<int, 2>>(int x, int y, JpegBlock* blocks)>;
  /// Writes a baseline JPEG of across x down units, at most 65500 pixels a side, with planes and quantization like this
  /// one. Huffman tables are those of this JPEG where they have a code for everything, as the standard's have, else
  /// ones made for the picture, which takes three times as long. Errors: kInvalidInput where libjpeg refuses.
  Result<Bytes> encode(int across, int down, const Units& unit) const;

 private:
  class Reader;
  explicit JpegBlocks(std::unique_ptr<Reader> reader);
  std::unique_ptr<Reader> reader_;
};

}  // namespace base
