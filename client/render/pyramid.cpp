#include "client/render/pyramid.h"

#include <algorithm>
#include <array>
#include <cstdint>

#include "base/check.h"

namespace client {
namespace {

base::Image premultipliedBottomUp(const base::Image& rgba) {
  base::Image result(rgba.width, rgba.height, 4);
  for (int y = 0; y < rgba.height; ++y) {
    const std::uint8_t* from = rgba.at(0, y);
    std::uint8_t* to = result.at(0, rgba.height - 1 - y);
    for (int x = 0; x < rgba.width; ++x, from += 4, to += 4) {
      const unsigned alpha = from[3];
      for (int c = 0; c < 3; ++c) to[c] = static_cast<std::uint8_t>((from[c] * alpha + 127) / 255);
      to[3] = from[3];
    }
  }
  return result;
}

/// Returns an image of half the size, rounded down as GL does. The last texel of an odd row or column averages three
/// source pixels.
base::Image halved(const base::Image& fine) {
  base::Image coarse(std::max(1, fine.width / 2), std::max(1, fine.height / 2), 4);
  for (int y = 0; y < coarse.height; ++y) {
    const int y0 = std::min(2 * y, fine.height - 1);
    const int y1 = y + 1 == coarse.height ? fine.height : y0 + 2;
    for (int x = 0; x < coarse.width; ++x) {
      const int x0 = std::min(2 * x, fine.width - 1);
      const int x1 = x + 1 == coarse.width ? fine.width : x0 + 2;
      std::array<unsigned, 4> sum{};
      for (int v = y0; v < y1; ++v)
        for (int u = x0; u < x1; ++u)
          for (unsigned c = 0; c < 4; ++c) sum[c] += fine.at(u, v)[c];
      const unsigned count = static_cast<unsigned>((y1 - y0) * (x1 - x0));
      for (unsigned c = 0; c < 4; ++c) coarse.at(x, y)[c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
    }
  }
  return coarse;
}

}  // namespace

int pyramidLevels(int width, int height) {
  int levels = 1;
  for (int side = std::max(width, height); side > 1; side /= 2) ++levels;
  return levels;
}

std::uint64_t pyramidBytes(int width, int height) {
  std::uint64_t bytes = 0;
  for (int level = 0; level < pyramidLevels(width, height); ++level)
    bytes += std::uint64_t{4} * static_cast<std::uint64_t>(std::max(1, width >> level)) *
             static_cast<std::uint64_t>(std::max(1, height >> level));
  return bytes;
}

std::vector<base::Image> premultipliedPyramid(const base::Image& rgba) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  LUMIGRID_CHECK(!rgba.empty());
  std::vector<base::Image> levels{premultipliedBottomUp(rgba)};
  while (levels.back().width > 1 || levels.back().height > 1) levels.push_back(halved(levels.back()));
  return levels;
}

}  // namespace client
