#pragma once
// Counts how many places of a picture find their colour in another picture of the same view nearby, which is what an
// appearance-preserving level of detail promises (Guthe et al. 2004, section 3.1).
#include <algorithm>
#include <array>
#include <cstdint>

#include "base/image.h"

namespace support {

struct FoundColors {
  std::uint64_t places = 0;  ///< of the picture's foreground
  std::uint64_t found = 0;
  double share() const { return places > 0 ? static_cast<double>(found) / static_cast<double>(places) : 1.0; }
  void add(const FoundColors& other) { places += other.places, found += other.found; }
};

/// A place looks for its colour at most `reach` of the truth's pixels away. The truth is as large as the picture, or a
/// whole number of times as large along each side: where its triangles are smaller than the picture's pixels, it has
/// more of their colours then. Both are RGBA.
struct ColorSearch {
  int reach = 1;
  int noise = 0;  ///< 0 … 255: by so much a channel may differ
  /// One pixel of the truth has the colour. Else each channel lies between the least and the largest one of those
  /// pixels: surfaces are continuous between pixels.
  bool in_one_pixel = false;
};

/// Whether a place of the picture finds its colour in the truth's foreground.
inline bool findsColor(const base::Image& picture, const base::Image& truth, int x, int y, const ColorSearch& search) {
  const int scale = truth.width / picture.width, reach = search.reach;
  const auto pixel = picture.at(x, y);
  constexpr std::array<int, 3> kNoneLow{256, 256, 256}, kNoneHigh{-1, -1, -1};
  std::array<int, 3> low = kNoneLow, high = kNoneHigh;
  // Twice the distance of pixels' centres is a whole number.
  const int middle_x = (2 * x + 1) * scale, middle_y = (2 * y + 1) * scale;
  for (int v = std::max(middle_y / 2 - reach, 0); v <= std::min(middle_y / 2 + reach, truth.height - 1); ++v) {
    for (int u = std::max(middle_x / 2 - reach, 0); u <= std::min(middle_x / 2 + reach, truth.width - 1); ++u) {
      const auto other = truth.at(u, v);
      const int dx = 2 * u + 1 - middle_x, dy = 2 * v + 1 - middle_y;
      if (other[3] < 128 || dx * dx + dy * dy > 4 * reach * reach) continue;
      if (search.in_one_pixel) low = kNoneLow, high = kNoneHigh;
      bool is_found = true;
      for (std::size_t k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], static_cast<int>(other[k]));
        high[k] = std::max(high[k], static_cast<int>(other[k]));
        is_found &= pixel[k] >= low[k] - search.noise && pixel[k] <= high[k] + search.noise;
      }
      if (is_found) return true;
    }
  }
  return false;
}

/// Counts the places of the picture's foreground, and those of them that find their colour.
inline FoundColors countFoundColors(const base::Image& picture, const base::Image& truth, const ColorSearch& search) {
  FoundColors count;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      if (picture.at(x, y)[3] < 128) continue;
      ++count.places;
      count.found += findsColor(picture, truth, x, y, search) ? 1 : 0;
    }
  return count;
}

}  // namespace support
