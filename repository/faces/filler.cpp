#include "repository/faces/filler.h"

#include <cstdint>
#include <vector>

#include "base/check.h"

namespace repository {
namespace {

/// A colour in one word, a byte a channel: red lowest, the highest byte 255. 0: the colour is not known.
using Cell = std::uint32_t;
constexpr Cell kKnown = 0xFF000000U;

Cell cellOf(const std::uint8_t* rgb) {
  return kKnown | Cell{rgb[0]} | Cell{rgb[1]} << 8 | Cell{rgb[2]} << 16;
}

/// The mean of the known colours of four, rounded half up; 0 when none is known. Two channels are added at a time, in
/// the halves of a word, as whole numbers: the mean is the same on every machine.
Cell meanOf(Cell a, Cell b, Cell c, Cell d) {
  constexpr Cell kHalves = 0x00FF00FFU;
  const Cell count = (a >> 31) + (b >> 31) + (c >> 31) + (d >> 31);
  if (count <= 1) return a | b | c | d;
  const Cell even = (a & kHalves) + (b & kHalves) + (c & kHalves) + (d & kHalves);
  const Cell odd = (a >> 8 & kHalves) + (b >> 8 & kHalves) + (c >> 8 & kHalves) + (d >> 8 & kHalves);
  const auto divided = [count](Cell sums) {
    if (count == 2) return (sums + 0x00010001U) >> 1 & kHalves;
    if (count == 4) return (sums + 0x00020002U) >> 2 & kHalves;
    return ((sums & 0xFFFFU) + 1) / 3 | ((sums >> 16) + 1) / 3 << 16;
  };
  return divided(even) | divided(odd) << 8;
}

/// One level of a pyramid; a level's cell stands for 2 × 2 of the level below, fewer at the far borders.
struct PyramidLevel {
  int width;
  int height;
  std::vector<Cell> cells;

  PyramidLevel(int w, int h) : width(w), height(h), cells(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)) {}
  Cell* row(int y) { return cells.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width); }
  const Cell* row(int y) const { return cells.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(width); }
};

PyramidLevel modelPixels(const base::Image& rgba, const base::Image& mask) {
  PyramidLevel level(rgba.width, rgba.height);
  for (std::size_t i = 0; i < level.cells.size(); ++i)
    if (mask.pixels[i] != 0) level.cells[i] = cellOf(&rgba.pixels[4 * i]);
  return level;
}

PyramidLevel halved(const PyramidLevel& fine) {
  PyramidLevel coarse((fine.width + 1) / 2, (fine.height + 1) / 2);
  const std::vector<Cell> beyond(static_cast<std::size_t>(fine.width), 0);
  for (int y = 0; y < coarse.height; ++y) {
    const Cell* upper = fine.row(2 * y);
    const Cell* lower = 2 * y + 1 < fine.height ? fine.row(2 * y + 1) : beyond.data();
    Cell* out = coarse.row(y);
    for (int x = 0; x < fine.width / 2; ++x)
      out[x] = meanOf(upper[2 * x], upper[2 * x + 1], lower[2 * x], lower[2 * x + 1]);
    if (fine.width % 2 != 0) out[coarse.width - 1] = meanOf(upper[fine.width - 1], 0, lower[fine.width - 1], 0);
  }
  return coarse;
}

void fillFrom(const PyramidLevel& coarse, PyramidLevel& fine) {
  for (int y = 0; y < fine.height; ++y) {
    const Cell* filler = coarse.row(y / 2);
    Cell* cells = fine.row(y);
    for (int x = 0; x < fine.width; ++x)
      if (cells[x] == 0) cells[x] = filler[x / 2];
  }
}

}  // namespace

base::Image fillBackground(const base::Image& rgba, const base::Image& mask) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  std::vector<PyramidLevel> pyramid = {modelPixels(rgba, mask)};
  while (pyramid.back().width > 1 || pyramid.back().height > 1) pyramid.push_back(halved(pyramid.back()));
  for (std::size_t level = pyramid.size() - 1; level > 0; --level) fillFrom(pyramid[level], pyramid[level - 1]);

  base::Image rgb(rgba.width, rgba.height, 3);
  std::uint8_t* out = rgb.pixels.data();
  for (const Cell cell : pyramid[0].cells)
    for (int shift = 0; shift < 24; shift += 8) *out++ = static_cast<std::uint8_t>(cell >> shift);
  return rgb;
}

}  // namespace repository
