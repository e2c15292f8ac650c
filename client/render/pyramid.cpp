#include "client/render/pyramid.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "base/check.h"

namespace client {
namespace {

std::uint32_t texelAt(const std::uint8_t* bytes) {
  std::uint32_t texel;
  std::memcpy(&texel, bytes, sizeof(texel));
  return texel;
}

bool isOpaque(const std::uint8_t* texels, int count) {
  unsigned all = 255;
  for (int x = 0; x < count; ++x) all &= texels[4 * x + 3];
  return all == 255;
}

/// Returns the means of the bytes of four texels, halves rounded up, two bytes at a time.
std::uint32_t meanOf(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
  constexpr std::uint32_t kEven = 0x00FF00FF, kHalf = 0x00020002;
  const std::uint32_t even = (a & kEven) + (b & kEven) + (c & kEven) + (d & kEven) + kHalf;
  const std::uint32_t odd = (a >> 8 & kEven) + (b >> 8 & kEven) + (c >> 8 & kEven) + (d >> 8 & kEven) + kHalf;
  return (even >> 2 & kEven) | (odd >> 2 & kEven) << 8;
}

/// Halves an image of even width and height.
base::Image halvedEvenly(const base::Image& fine) {
  base::Image coarse(fine.width / 2, fine.height / 2, 4);
  for (int y = 0; y < coarse.height; ++y) {
    const std::uint8_t* above = fine.at(0, 2 * y);
    const std::uint8_t* below = fine.at(0, 2 * y + 1);
    std::uint8_t* to = coarse.at(0, y);
    for (int x = 0; x < coarse.width; ++x) {
      const std::uint32_t mean = meanOf(texelAt(above + 8 * x), texelAt(above + 8 * x + 4), texelAt(below + 8 * x),
                                        texelAt(below + 8 * x + 4));
      std::memcpy(to + 4 * x, &mean, sizeof(mean));
    }
  }
  return coarse;
}

base::Image premultipliedBottomUp(const base::Image& rgba) {
  base::Image result(rgba.width, rgba.height, 4);
  for (int y = 0; y < rgba.height; ++y) {
    const std::uint8_t* from = rgba.at(0, y);
    std::uint8_t* to = result.at(0, rgba.height - 1 - y);
    if (isOpaque(from, rgba.width)) {
      std::memcpy(to, from, 4 * static_cast<std::size_t>(rgba.width));
      continue;
    }
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
  if (fine.width % 2 == 0 && fine.height % 2 == 0) return halvedEvenly(fine);
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
