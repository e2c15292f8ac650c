#pragma once
// Measures by which tests tell two pictures apart.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "base/image.h"

namespace support {

/// The share of the pixels of which some channel differs by more than a tenth. Both are RGBA of one size.
inline double shareDifferent(const base::Image& a, const base::Image& b) {
  EXPECT_EQ(a.pixels.size(), b.pixels.size());
  std::size_t different = 0;
  for (std::size_t i = 0; i < a.pixels.size(); i += 4) {
    int most = 0;
    for (std::size_t c = 0; c < 4; ++c) most = std::max(most, std::abs(a.pixels[i + c] - b.pixels[i + c]));
    different += most > 24 ? 1 : 0;
  }
  return static_cast<double>(different) / (static_cast<double>(a.pixels.size()) / 4.0);
}

}  // namespace support
