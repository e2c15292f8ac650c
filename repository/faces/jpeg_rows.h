#pragma once
// A JPEG made row by row, for pictures that never are in memory whole.
#include <memory>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/faces/jpeg.h"

namespace repository {

class JpegRows {
 public:
  /// width, height: 1..65500 pixels; quality 1..100. Baseline with the standard Huffman tables: those made for the
  /// picture (encodeJpeg) need all of it first. The bytes are appended to `out`, which outlives this.
  static base::Result<std::unique_ptr<JpegRows>> begin(int width, int height, int quality, Subsampling subsampling,
                                                       base::Bytes& out);
  ~JpegRows();
  /// The next rows, from the top; 3 channels, as wide as the picture. The last one ends the picture.
  base::Result<void> add(const base::Image& rgb);

 private:
  JpegRows() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace repository
