#pragma once
// Encodes a picture row by row, so that it is never whole in memory.
#include "base/error.h"
#include "base/image.h"

namespace base {

class ImageRows {
 public:
  virtual ~ImageRows() = default;
  /// Adds the next rows from the top, as wide and with as many channels as the picture. The last row ends the picture.
  virtual Result<void> add(const Image& rows) = 0;
};

}  // namespace base
