#include "lod/texture/fill.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

namespace lod::texture {
namespace {

// A view at a lower resolution, with its own texels.
struct CoarseLevel {
  std::vector<std::uint8_t> pixels, mask;
  FillView view;

  CoarseLevel(int width, int height, int channels)
      : pixels(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * static_cast<std::size_t>(channels)),
        mask(static_cast<std::size_t>(width) * static_cast<std::size_t>(height)) {
    view = {pixels.data(), std::ptrdiff_t{width} * channels, channels, {mask.data(), width, width, height}};
  }
};

template <int kChannels>
struct Sum {
  std::array<unsigned, kChannels> total{};
  unsigned count = 0;

  void add(const std::uint8_t* texel) {
    for (int c = 0; c < kChannels; ++c) total[c] += texel[c];
    ++count;
  }
  void writeMean(std::uint8_t* texel) const {
    for (int c = 0; c < kChannels; ++c) texel[c] = static_cast<std::uint8_t>((total[c] + count / 2) / count);
  }
};

std::uint16_t pairAt(const std::uint8_t* mask) {
  std::uint16_t pair = 0;
  std::memcpy(&pair, mask, sizeof(pair));
  return pair;
}
constexpr std::uint16_t kBothCovered = 0x0101;

// Halves two rows (one and the same where the last is alone) into one: means of the covered texels of each 2 × 2.
template <int kChannels>
void halveRows(const FillView& fine, int y, const FillView& coarse) {
  const int lower = std::min(2 * y + 1, fine.mask.height - 1);
  const std::array<const std::uint8_t*, 2> rows{fine.pixels + 2 * y * fine.stride, fine.pixels + lower * fine.stride};
  const std::array<const std::uint8_t*, 2> masks{fine.mask.row(2 * y), fine.mask.row(lower)};
  std::uint8_t* out = coarse.pixels + y * coarse.stride;
  std::uint8_t* out_mask = coarse.mask.row(y);
  for (int x = 0; x < coarse.mask.width; ++x, out += kChannels) {
    const bool whole = 2 * x + 1 < fine.mask.width;
    if (whole && pairAt(masks[0] + 2 * x) == kBothCovered && pairAt(masks[1] + 2 * x) == kBothCovered) {
      const std::uint8_t* a = rows[0] + 2 * x * kChannels;
      const std::uint8_t* b = rows[1] + 2 * x * kChannels;
      for (int c = 0; c < kChannels; ++c)
        out[c] = static_cast<std::uint8_t>((a[c] + a[c + kChannels] + b[c] + b[c + kChannels] + 2U) >> 2);
      out_mask[x] = 1;
      continue;
    }
    Sum<kChannels> sum;
    for (int i = 0; i < 2; ++i)
      for (int column = 2 * x; column < 2 * x + (whole ? 2 : 1); ++column)
        if (masks[i][column] == 1) sum.add(rows[i] + column * kChannels);
    if (sum.count == 0) continue;
    sum.writeMean(out);
    out_mask[x] = 1;
  }
}

bool isCovered(const MaskView& mask) {
  for (int y = 0; y < mask.height; ++y)
    if (std::memchr(mask.row(y), 0, static_cast<std::size_t>(mask.width)) != nullptr) return false;
  return true;
}

// Fills the uncovered texel x of row y from covered neighbours; returns false where it has none.
template <int kChannels>
bool fillFromNeighbours(const FillView& view, int x, int y) {
  Sum<kChannels> sum;
  const int first = std::max(x - 1, 0), last = std::min(x + 1, view.mask.width - 1);
  for (int row = std::max(y - 1, 0); row <= std::min(y + 1, view.mask.height - 1); ++row) {
    const std::uint8_t* mask = view.mask.row(row);
    for (int column = first; column <= last; ++column)
      if (mask[column] == 1) sum.add(view.pixels + row * view.stride + column * kChannels);
  }
  if (sum.count == 0) return false;
  sum.writeMean(view.pixels + y * view.stride + x * kChannels);
  return true;
}

// Whether none of the nine texels around (x, y) is covered. May say no where it would have to look too closely.
bool isFar(const MaskView& mask, int x, int y) {
  if (x < 1 || y < 1 || x + 3 > mask.width || y + 2 > mask.height) return false;
  std::uint32_t any = 0;
  for (int row = y - 1; row <= y + 1; ++row) {
    std::uint16_t left = 0;
    std::memcpy(&left, mask.row(row) + x - 1, sizeof(left));
    any |= left | mask.row(row)[x + 1];
  }
  return (any & kBothCovered) == 0;
}

// Returns the first uncovered texel of a row from x on, or the row's end.
int nextUncovered(const MaskView& mask, int x, int y) {
  if (x >= mask.width) return mask.width;
  const std::uint8_t* row = mask.row(y);
  if (row[x] == 0) return x;  // most of them follow each other
  const void* next = std::memchr(row + x, 0, static_cast<std::size_t>(mask.width - x));
  return next == nullptr ? mask.width : static_cast<int>(static_cast<const std::uint8_t*>(next) - row);
}

template <int kChannels>
void fillLevel(const FillView& view, const FillView* coarse) {
  for (int y = 0; y < view.mask.height; ++y) {
    std::uint8_t* row = view.pixels + y * view.stride;
    const std::uint8_t* coarse_row = coarse == nullptr ? nullptr : coarse->pixels + y / 2 * coarse->stride;
    std::uint8_t* mask = view.mask.row(y);
    for (int x = nextUncovered(view.mask, 0, y); x < view.mask.width; x = nextUncovered(view.mask, x + 1, y)) {
      const bool filled = !isFar(view.mask, x, y) && fillFromNeighbours<kChannels>(view, x, y);
      if (!filled && coarse != nullptr) std::memcpy(row + x * kChannels, coarse_row + x / 2 * kChannels, kChannels);
      mask[x] = 2;
    }
  }
}

template <int kChannels>
void fillFromCoarser(const FillView& view) {
  // Halve until all is covered, or one texel is left.
  std::vector<CoarseLevel> levels;
  for (const FillView* fine = &view; !isCovered(fine->mask) && (fine->mask.width > 1 || fine->mask.height > 1);
       fine = &levels.back().view) {
    const FillView from = *fine;
    CoarseLevel level((from.mask.width + 1) / 2, (from.mask.height + 1) / 2, kChannels);
    for (int y = 0; y < level.view.mask.height; ++y) halveRows<kChannels>(from, y, level.view);
    levels.push_back(std::move(level));
  }

  // Then fill each level, the coarsest first.
  for (std::size_t i = levels.size(); i-- > 0;)
    fillLevel<kChannels>(levels[i].view, i + 1 < levels.size() ? &levels[i + 1].view : nullptr);
  fillLevel<kChannels>(view, levels.empty() ? nullptr : &levels[0].view);
}

}  // namespace

void fillUncovered(const FillView& view) {
  if (view.channels == 3)
    fillFromCoarser<3>(view);
  else
    fillFromCoarser<4>(view);
}

}  // namespace lod::texture
