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

/// A place finds its colour where each channel lies between the least and the largest one of the truth's foreground at
/// most `reach` pixels away, or beyond by at most `noise` (0 … 255): surfaces are continuous between pixels. Both
/// pictures are RGBA and of one size. A place with no foreground of the truth nearby finds nothing.
inline FoundColors countFoundColors(const base::Image& picture, const base::Image& truth, int reach, int noise) {
  FoundColors count;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const auto pixel = picture.at(x, y);
      if (pixel[3] < 128) continue;
      ++count.places;
      std::array<int, 3> low{256, 256, 256}, high{-1, -1, -1};
      for (int v = std::max(y - reach, 0); v <= std::min(y + reach, truth.height - 1); ++v)
        for (int u = std::max(x - reach, 0); u <= std::min(x + reach, truth.width - 1); ++u) {
          const auto other = truth.at(u, v);
          if (other[3] < 128 || (u - x) * (u - x) + (v - y) * (v - y) > reach * reach) continue;
          for (std::size_t k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], static_cast<int>(other[k]));
            high[k] = std::max(high[k], static_cast<int>(other[k]));
          }
        }
      bool is_found = true;
      for (std::size_t k = 0; k < 3; ++k) is_found &= pixel[k] >= low[k] - noise && pixel[k] <= high[k] + noise;
      count.found += is_found ? 1 : 0;
    }
  return count;
}

}  // namespace support
