#include "base/picture_error.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace base {

void PictureError::add(double difference) {
  squared += difference * difference;
  absolute += std::abs(difference);
  ++samples;
}

void PictureError::add(const PictureError& other) {
  squared += other.squared;
  absolute += other.absolute;
  samples += other.samples;
}

double PictureError::psnr() const {
  if (samples == 0 || squared <= 0.0) return kEqualDb;
  return std::min(kEqualDb, 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(samples) / squared));
}

PictureError pictureError(const Image& truth, const Image& picture) {
  LUMIGRID_CHECK(truth.width == picture.width && truth.height == picture.height);
  LUMIGRID_CHECK(truth.channels == 4 && picture.channels == 4);
  PictureError error;
  for (std::size_t i = 0; i < truth.pixels.size(); i += 4) {
    const std::uint8_t* a = &truth.pixels[i];
    const std::uint8_t* b = &picture.pixels[i];
    if (a[3] < kCoverageThreshold && b[3] < kCoverageThreshold) continue;
    for (int c = 0; c < 3; ++c) error.add(static_cast<double>(overGrey(a, c) - overGrey(b, c)));
  }
  return error;
}

PictureError modelError(const Image& rgba, const Image& rgb) {
  LUMIGRID_CHECK(rgba.width == rgb.width && rgba.height == rgb.height);
  LUMIGRID_CHECK(rgba.channels == 4 && rgb.channels == 3);
  PictureError error;
  for (std::size_t i = 0; 4 * i < rgba.pixels.size(); ++i) {
    if (rgba.pixels[4 * i + 3] < kCoverageThreshold) continue;
    for (std::size_t c = 0; c < 3; ++c) error.add(int{rgba.pixels[4 * i + c]} - int{rgb.pixels[3 * i + c]});
  }
  return error;
}

}  // namespace base
