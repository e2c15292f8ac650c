#pragma once
// Writes a PNG row by row, for pictures that are never in memory as a whole.
#include <memory>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace base {

class PngRows {
 public:
  /// width, height: 1 or more pixels; 3 or 4 channels of 8 bits. The bytes are appended to `out`, which outlives this.
  static Result<std::unique_ptr<PngRows>> begin(int width, int height, int channels, Bytes& out);
  ~PngRows();
  /// The next rows, from the top; as wide and with as many channels as the picture. The last one ends the picture.
  Result<void> add(const Image& rows);

 private:
  PngRows() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace base
