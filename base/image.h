#pragma once
// Pixel arrays. Row 0 is the top row, pixels are interleaved, rows are not padded.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace base {

using Rgb = std::array<std::uint8_t, 3>;  ///< sRGB

struct Image {
  int width = 0;
  int height = 0;
  int channels = 0;  ///< 1 grey or mask, 3 RGB, 4 RGBA; sRGB as stored
  std::vector<std::uint8_t> pixels;

  Image() = default;
  Image(int w, int h, int c)
      : width(w),
        height(h),
        channels(c),
        pixels(static_cast<std::size_t>(w) * static_cast<std::size_t>(h) * static_cast<std::size_t>(c)) {}
  bool empty() const { return pixels.empty(); }
  std::uint8_t* at(int x, int y) { return pixels.data() + offset(x, y); }
  const std::uint8_t* at(int x, int y) const { return pixels.data() + offset(x, y); }

 private:
  std::size_t offset(int x, int y) const {
    return (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x)) *
           static_cast<std::size_t>(channels);
  }
};

}  // namespace base
