#pragma once
// Encodes a JPEG row by row, for pictures that are never whole in memory.
#include <memory>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/faces/jpeg.h"

namespace repository {

class JpegRows {
 public:
  /// width and height are 1..65500 pixels, quality is 1..100. The JPEG is a baseline one with the standard Huffman
  /// tables, since tables made for the picture (encodeJpeg) need all of it first. The bytes are appended to `out`,
  /// which must outlive this object.
  static base::Result<std::unique_ptr<JpegRows>> begin(int width, int height, int quality, Subsampling subsampling,
                                                       base::Bytes& out);
  ~JpegRows();
  /// Adds the next rows from the top, with 3 channels and as wide as the picture. The last row ends the picture.
  base::Result<void> add(const base::Image& rgb);

 private:
  JpegRows() = default;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace repository
