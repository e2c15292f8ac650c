#include "server/render/background.h"

#include "base/check.h"

namespace server {

base::Image compositeOver(const base::Image& rgba, const Rgb& background) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  base::Image rgb(rgba.width, rgba.height, 3);
  for (std::size_t i = 0; i < rgb.pixels.size() / 3; ++i) {
    const int alpha = rgba.pixels[4 * i + 3];
    for (std::size_t c = 0; c < 3; ++c)
      rgb.pixels[3 * i + c] =
          static_cast<std::uint8_t>((rgba.pixels[4 * i + c] * alpha + background[c] * (255 - alpha) + 127) / 255);
  }
  return rgb;
}

}  // namespace server
