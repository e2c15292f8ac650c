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

PictureError foregroundError(const Image& truth, const Image& picture) {
  LUMIGRID_CHECK(truth.width == picture.width && truth.height == picture.height);
  LUMIGRID_CHECK(truth.channels == 4 && picture.channels == 4);
  const auto overGrey = [](const Image& image, std::size_t pixel, std::size_t channel) {
    const double alpha = image.pixels[4 * pixel + 3] / 255.0;
    return alpha * image.pixels[4 * pixel + channel] + (1.0 - alpha) * kMidGrey;
  };
  PictureError error;
  for (std::size_t i = 0; 4 * i < truth.pixels.size(); ++i) {
    if (std::max(truth.pixels[4 * i + 3], picture.pixels[4 * i + 3]) < kForegroundThreshold) continue;
    for (std::size_t c = 0; c < 3; ++c) error.add(overGrey(truth, i, c) - overGrey(picture, i, c));
  }
  return error;
}

}  // namespace base
