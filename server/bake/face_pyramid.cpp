#include "server/bake/face_pyramid.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "server/bake/face_encoder.h"

namespace server {
namespace {

using repository::kTileBorder;
using repository::kTileCore;
using repository::kTileSide;

constexpr int kChannels = 4;

/// Red, green, blue and alpha of a pixel, the colours times alpha: 0 … 255².
using Premultiplied = std::array<int, kChannels>;

Premultiplied premultiplied(const std::uint8_t* pixel) {
  const int alpha = pixel[3];
  return {pixel[0] * alpha, pixel[1] * alpha, pixel[2] * alpha, 255 * alpha};
}

/// The place of a tile's core in the picture of its level.
struct CorePlace {
  int x = 0, y = 0;
};

CorePlace coreOf(const repository::TilePlace& place) {
  const std::uint32_t border = kTileBorder << place.depth;
  return {static_cast<int>(border + kTileCore * place.x), static_cast<int>(border + kTileCore * place.y)};
}

/// The coarser level as a bilinear filter shows it at a pixel of the finer one, times 16. A finer pixel's centre lies
/// a quarter of a coarser pixel from the centre of that which holds it.
Premultiplied shownBy(const base::Image& coarser, int x, int y) {
  const int near_x = x / 2;
  const int near_y = y / 2;
  const int far_x = near_x + (x % 2 == 0 ? -1 : 1);
  const int far_y = near_y + (y % 2 == 0 ? -1 : 1);
  const Premultiplied near = premultiplied(coarser.at(near_x, near_y));
  const Premultiplied beside = premultiplied(coarser.at(far_x, near_y));
  const Premultiplied above = premultiplied(coarser.at(near_x, far_y));
  const Premultiplied across = premultiplied(coarser.at(far_x, far_y));
  Premultiplied shown{};
  for (std::size_t c = 0; c < kChannels; ++c) shown[c] = 9 * near[c] + 3 * (beside[c] + above[c]) + across[c];
  return shown;
}

/// The mean of 2 × 2 pixels of two rows.
void writeMean(const std::uint8_t* upper, const std::uint8_t* lower, std::uint8_t* mean) {
  const std::array<const std::uint8_t*, 4> pixels{upper, upper + kChannels, lower, lower + kChannels};
  unsigned alpha = 0;
  std::array<unsigned, 3> colour{};
  for (const std::uint8_t* pixel : pixels) {
    alpha += pixel[3];
    for (std::size_t c = 0; c < colour.size(); ++c) colour[c] += unsigned{pixel[c]} * pixel[3];
  }
  if (alpha == 0) return;
  for (std::size_t c = 0; c < colour.size(); ++c) mean[c] = static_cast<std::uint8_t>((colour[c] + alpha / 2) / alpha);
  mean[3] = static_cast<std::uint8_t>((alpha + 2) / 4);
}

}  // namespace

base::Image halved(const base::Image& rgba) {
  LUMIGRID_CHECK_EQ(rgba.channels, kChannels);
  LUMIGRID_CHECK_EQ(rgba.width % 2 + rgba.height % 2, 0);
  base::Image half(rgba.width / 2, rgba.height / 2, kChannels);
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < half.width; ++x) writeMean(rgba.at(2 * x, 2 * y), rgba.at(2 * x, 2 * y + 1), half.at(x, y));
  return half;
}

FacePyramid::FacePyramid(const base::Image& finest, std::uint32_t depth) : finest_(finest), coarser_(depth) {
  LUMIGRID_CHECK(depth >= 1 && depth <= repository::kMaxTileDepth);
  LUMIGRID_CHECK_EQ(finest.width, static_cast<int>(kTileSide << depth));
  LUMIGRID_CHECK_EQ(finest.height, finest.width);
  for (std::uint32_t l = depth; l > 0; --l) coarser_[l - 1] = halved(level(l));
}

base::Image FacePyramid::imageOf(std::uint32_t tile) const {
  const repository::TilePlace place = repository::placeOfTile(tile);
  const base::Image& from = level(place.depth);
  const CorePlace core = coreOf(place);
  constexpr int kSide = static_cast<int>(kTileSide);
  constexpr int kBorder = static_cast<int>(kTileBorder);
  base::Image image(kSide, kSide, kChannels);
  for (int y = 0; y < kSide; ++y)
    std::copy_n(from.at(core.x - kBorder, core.y - kBorder + y), kChannels * kSide, image.at(0, y));
  return image;
}

double FacePyramid::differenceFromParent(std::uint32_t tile) const {
  const repository::TilePlace place = repository::placeOfTile(tile);
  LUMIGRID_CHECK(place.depth > 0);
  const base::Image& fine = level(place.depth);
  const base::Image& coarse = level(place.depth - 1);
  const CorePlace core = coreOf(place);
  double squares = 0.0;
  std::uint64_t pixels = 0;
  for (int y = core.y; y < core.y + static_cast<int>(kTileCore); ++y)
    for (int x = core.x; x < core.x + static_cast<int>(kTileCore); ++x) {
      const Premultiplied own = premultiplied(fine.at(x, y));
      const Premultiplied shown = shownBy(coarse, x, y);
      if (own[3] == 0 && shown[3] == 0) continue;
      ++pixels;
      std::int64_t sum = 0;
      for (std::size_t c = 0; c < kChannels; ++c) {
        const std::int64_t difference = 16 * own[c] - shown[c];
        sum += difference * difference;
      }
      squares += static_cast<double>(sum);
    }
  constexpr double kUnit = 16.0 * 255.0;
  return pixels == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(kChannels * pixels)) / kUnit;
}

bool FacePyramid::showsModel(std::uint32_t tile) const {
  const repository::TilePlace place = repository::placeOfTile(tile);
  const base::Image& from = level(place.depth);
  const CorePlace core = coreOf(place);
  constexpr int kSide = static_cast<int>(kTileSide);
  constexpr int kBorder = static_cast<int>(kTileBorder);
  for (int y = core.y - kBorder; y < core.y - kBorder + kSide; ++y) {
    const std::uint8_t* row = from.at(core.x - kBorder, y);
    for (int x = 0; x < kSide; ++x)
      if (row[kChannels * x + 3] >= kStoredCoverage) return true;
  }
  return false;
}

std::vector<ChosenTile> chooseTiles(const FacePyramid& pyramid, double threshold,
                                    const std::vector<std::uint32_t>* wanted) {
  // Children have larger numbers than their parents, so going down from the last tile meets them first.
  const std::uint32_t first_finest = repository::firstTileOf(pyramid.depth());
  std::vector<std::uint8_t> children(first_finest);
  std::vector<ChosenTile> chosen;
  for (std::uint32_t tile = repository::firstTileOf(pyramid.depth() + 1); tile-- > 0;) {
    if (wanted != nullptr && !std::binary_search(wanted->begin(), wanted->end(), tile)) continue;
    const std::uint8_t own = tile < first_finest ? children[tile] : 0;
    const bool is_kept =
        tile == 0 || own != 0 || (pyramid.showsModel(tile) && pyramid.differenceFromParent(tile) > threshold);
    if (!is_kept) continue;
    chosen.push_back({tile, own});
    if (tile == 0) break;
    const std::uint32_t parent = repository::parentOfTile(tile);
    children[parent] |= static_cast<std::uint8_t>(1U << (tile - repository::childOfTile(parent, 0)));
  }
  std::reverse(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace server
