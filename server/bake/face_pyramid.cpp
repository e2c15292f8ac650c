#include "server/bake/face_pyramid.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <span>

#include "base/check.h"
#include "server/bake/face_encoder.h"

namespace server {
namespace {

using repository::kTileBorder;
using repository::kTileCore;
using repository::kTileSide;

constexpr int kChannels = 4;

/// The place of a tile's core in the picture of its level.
struct CorePlace {
  int x = 0, y = 0;
};

CorePlace coreOf(const repository::TilePlace& place) {
  const std::uint32_t border = kTileBorder << place.depth;
  return {static_cast<int>(border + kTileCore * place.x), static_cast<int>(border + kTileCore * place.y)};
}

/// Red, green, blue and alpha of a row's pixels, the colours times alpha: 0 … 255². These, and all that is made of them
/// below, are whole numbers that floats hold exactly.
void premultiply(const std::uint8_t* row, std::span<float> out) {
  for (std::size_t i = 0; i < out.size(); i += kChannels) {
    const auto alpha = static_cast<float>(row[i + 3]);
    for (std::size_t c = 0; c < 3; ++c) out[i + c] = static_cast<float>(row[i + c]) * alpha;
    out[i + 3] = 255.0F * alpha;
  }
}

/// Rows of a coarser level as a bilinear filter shows them at the rows of the finer one, times 16. A finer pixel's
/// centre lies a quarter of a coarser pixel from the centre of that which holds it.
class ShownRow {
 public:
  /// For `pixels` of the finer level from the even one `x` on.
  ShownRow(const base::Image& coarser, int x, std::size_t pixels)
      : coarser_(coarser), first_(x / 2 - 1), near_(kChannels * (pixels / 2 + 2)), far_(near_.size()) {}

  /// Writes row y, premultiplied.
  void at(int y, std::span<float> shown) {
    const int near_y = y / 2;
    premultiply(coarser_.at(first_, near_y), near_);
    premultiply(coarser_.at(first_, near_y + (y % 2 == 0 ? -1 : 1)), far_);
    for (std::size_t i = 0; i < near_.size(); ++i) near_[i] = 3.0F * near_[i] + far_[i];
    // Pixels 2 i and 2 i + 1 lie in pixel i + 1 of these, between those before and behind it.
    const float* from = near_.data();
    for (std::size_t i = 0; i < shown.size(); i += 2 * kChannels, from += kChannels)
      for (std::size_t c = 0; c < kChannels; ++c) {
        const float middle = 3.0F * from[kChannels + c];
        shown[i + c] = middle + from[c];
        shown[i + kChannels + c] = middle + from[2 * kChannels + c];
      }
  }

 private:
  const base::Image& coarser_;
  int first_;
  std::vector<float> near_, far_;
};

/// Writes the mean of 2 × 2 pixels of two rows to `mean`, which is transparent black before. Returns whether any of
/// them is stored as model.
bool writeMean(const std::uint8_t* upper, const std::uint8_t* lower, std::uint8_t* mean) {
  // Most pixels of a face are empty or covered as a whole, and then as the general rule below has it.
  constexpr std::uint64_t kAlphas = 0xFF000000FF000000U, kHalves = 0x00FF00FF00FF00FFU;
  std::uint64_t above = 0, below = 0;
  std::memcpy(&above, upper, sizeof(above));
  std::memcpy(&below, lower, sizeof(below));
  if (((above | below) & kAlphas) == 0) return false;
  if ((above & below & kAlphas) == kAlphas) {
    const auto sums = [](std::uint64_t pixels) { return (pixels & kHalves) + (pixels >> 32); };
    const std::uint64_t even = sums(above & kHalves) + sums(below & kHalves);
    const std::uint64_t odd = sums(above >> 8 & kHalves) + sums(below >> 8 & kHalves);
    const auto quarter = [](std::uint64_t sum) {
      return static_cast<std::uint32_t>((sum + 0x00020002U) >> 2 & 0x00FF00FFU);
    };
    const std::uint32_t all = quarter(even) | quarter(odd) << 8;
    std::memcpy(mean, &all, sizeof(all));
    return true;
  }
  const std::array<const std::uint8_t*, 4> pixels{upper, upper + kChannels, lower, lower + kChannels};
  unsigned alpha = 0;
  std::array<unsigned, 3> colour{};
  bool is_model = false;
  for (const std::uint8_t* pixel : pixels) {
    alpha += pixel[3];
    is_model |= pixel[3] >= kStoredCoverage;
    for (std::size_t c = 0; c < colour.size(); ++c) colour[c] += unsigned{pixel[c]} * pixel[3];
  }
  for (std::size_t c = 0; c < colour.size(); ++c) mean[c] = static_cast<std::uint8_t>((colour[c] + alpha / 2) / alpha);
  mean[3] = static_cast<std::uint8_t>((alpha + 2) / 4);
  return is_model;
}

// Pixels of a block along its sides. Tiles begin and end between blocks.
constexpr int kBlockWide = 4, kBlockHigh = 2;
static_assert(kTileCore % kBlockWide == 0 && kTileBorder % kBlockWide == 0 && kTileSide % kBlockWide == 0);

/// The picture at half its resolution: each pixel is the mean of 2 × 2, its colour that of what they cover. Notes which
/// blocks of the picture show model.
base::Image halved(const base::Image& rgba, std::vector<std::uint8_t>& model) {
  base::Image half(rgba.width / 2, rgba.height / 2, kChannels);
  model.assign(static_cast<std::size_t>(rgba.width / kBlockWide) * static_cast<std::size_t>(rgba.height / kBlockHigh),
               0);
  std::uint8_t* block = model.data();
  for (int y = 0; y < half.height; ++y) {
    const std::uint8_t *upper = rgba.at(0, 2 * y), *lower = rgba.at(0, 2 * y + 1);
    std::uint8_t* mean = half.at(0, y);
    for (int x = 0; x < rgba.width / kBlockWide; ++x, upper += 4 * kChannels, lower += 4 * kChannels) {
      const bool left = writeMean(upper, lower, mean);
      const bool right = writeMean(upper + 2 * kChannels, lower + 2 * kChannels, mean + kChannels);
      *block++ = left || right ? 1 : 0;
      mean += 2 * kChannels;
    }
  }
  return half;
}

}  // namespace

FacePyramid::FacePyramid(const base::Image& finest, std::uint32_t depth)
    : finest_(finest), coarser_(depth), model_(depth) {
  LUMIGRID_CHECK(depth >= 1 && depth <= repository::kMaxTileDepth);
  LUMIGRID_CHECK_EQ(finest.width, static_cast<int>(kTileSide << depth));
  LUMIGRID_CHECK_EQ(finest.height, finest.width);
  for (std::uint32_t l = depth; l > 0; --l) coarser_[l - 1] = halved(level(l), model_[l - 1]);
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
  ShownRow rows(coarse, core.x, kTileCore);
  std::vector<float> own(kChannels * kTileCore), shown(own.size());
  for (int y = core.y; y < core.y + static_cast<int>(kTileCore); ++y) {
    premultiply(fine.at(core.x, y), own);
    rows.at(y, shown);
    std::array<double, kChannels> sums{};
    for (std::size_t i = 0; i < own.size(); i += kChannels) {
      for (std::size_t c = 0; c < kChannels; ++c) {
        const double difference = 16.0F * own[i + c] - shown[i + c];
        sums[c] += difference * difference;
      }
      pixels += own[i + 3] + shown[i + 3] > 0.0F ? 1 : 0;
    }
    squares += sums[0] + sums[1] + sums[2] + sums[3];
  }
  constexpr double kUnit = 16.0 * 255.0;
  return pixels == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(kChannels * pixels)) / kUnit;
}

bool FacePyramid::showsModel(std::uint32_t tile) const {
  const repository::TilePlace place = repository::placeOfTile(tile);
  if (place.depth == 0) return server::showsModel(level(0));
  const CorePlace core = coreOf(place);
  constexpr int kSide = static_cast<int>(kTileSide);
  constexpr int kBorder = static_cast<int>(kTileBorder);
  const auto across = static_cast<std::size_t>(level(place.depth).width / kBlockWide);
  const auto first = static_cast<std::size_t>((core.x - kBorder) / kBlockWide);
  const auto top = static_cast<std::size_t>((core.y - kBorder) / kBlockHigh);
  const std::vector<std::uint8_t>& model = model_[place.depth - 1];
  for (std::size_t y = top; y < top + kSide / kBlockHigh; ++y)
    if (std::memchr(&model[y * across + first], 1, kSide / kBlockWide) != nullptr) return true;
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
