#pragma once
// The functions by which the views of all streamed methods draw.
#include <array>

#include "base/gl/gl.h"

namespace client {

/// Clears colour and depth of the framebuffer bound now.
void clearPicture(const std::array<float, 4>& background);
/// Waits until the GPU is done with the framebuffer bound now.
void waitForGpu();

/// Says when the GPU is done with a picture, without waiting for it: a page goes on decoding meanwhile.
class PictureFence {
 public:
  PictureFence() = default;
  ~PictureFence() { remove(); }
  PictureFence(const PictureFence&) = delete;
  PictureFence& operator=(const PictureFence&) = delete;

  /// Follows all that was drawn so far; one that stood before is removed.
  void set();
  bool isSet() const { return sync_ != nullptr; }
  /// Returns whether the GPU has come to it, or will not tell; it is removed then.
  bool hasPassed();
  void remove();

 private:
  GLsync sync_ = nullptr;
};

}  // namespace client
