// Feeds any bytes to decodeJpeg, and to JpegBlocks, which must find the same picture in them.
#include "base/jpeg/jpeg.h"

#include "base/check.h"
#include "base/jpeg/blocks.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr int kMaxSide = 128;

base::Image pattern(int width, int height) {
  base::Image image(width, height, 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<std::uint8_t>(i * i >> 5);
  return image;
}
base::Bytes seed(int width, int height, base::Subsampling subsampling) {
  return *base::encodeJpeg(pattern(width, height), 60, subsampling);
}
// With the standard's tables, so that its units are copied as they are coded.
base::Bytes standardSeed(int width, int height, base::Subsampling subsampling) {
  base::Bytes bytes;
  LUMIGRID_CHECK((*base::beginJpeg(width, height, 60, subsampling, bytes))->add(pattern(width, height)));
  return bytes;
}

// Copies all units, and reads them in the copy.
void copyUnits(base::ByteView bytes) {
  constexpr std::uint64_t kMemory = std::uint64_t{1} << 20;
  const auto blocks = base::JpegBlocks::read(bytes, kMemory);
  const auto quarter = base::JpegBlocks::readQuarter(bytes, kMemory);
  if (!blocks) {
    LUMIGRID_CHECK(!quarter);
    return;
  }
  if (quarter) {
    const auto again = base::JpegBlocks::read(bytes, kMemory, quarter->units);
    LUMIGRID_CHECK(again && again->block(0, 0, 0) == blocks->block(0, 0, 0));
    const int x = blocks->plane(0).wide - 1, y = blocks->plane(0).high - 1;
    LUMIGRID_CHECK(again->block(0, x, y) == blocks->block(0, x, y) && again->mean(0, x, y) == blocks->mean(0, x, y));
  }
  LUMIGRID_CHECK(blocks->width() >= 1 && blocks->height() >= 1);
  std::array<base::JpegBlock, 3> at{};
  blocks->blocksAt(blocks->width() - 1, blocks->height() - 1, at);
  for (int p = 0; p < blocks->planes(); ++p) {
    const base::JpegPlane& plane = blocks->plane(p);
    LUMIGRID_CHECK(at[static_cast<std::size_t>(p)] == blocks->block(p, plane.wide - 1, plane.high - 1));
  }
  std::array<base::JpegBlock, base::JpegBlocks::kMostInUnit> unit{};
  blocks->unitBlocks(0, 0, unit);
  LUMIGRID_CHECK(unit[0] == blocks->block(0, 0, 0));
  blocks->unitBlocks((blocks->width() - 1) / blocks->unitWidth(), (blocks->height() - 1) / blocks->unitHeight(), unit);
  const int across = blocks->width() / blocks->unitWidth(), down = blocks->height() / blocks->unitHeight();
  if (across == 0 || down == 0) return;
  const auto copy = blocks->encode(across, down, [](int x, int y, base::JpegBlock*) {
    return std::optional(std::array{x, y});
  });
  if (!copy) return;  // libjpeg refuses what it reads
  const bool whole = across * blocks->unitWidth() == blocks->width() && down * blocks->unitHeight() == blocks->height();
  const auto before = base::decodeJpeg(bytes), after = base::decodeJpeg(*copy);
  LUMIGRID_CHECK(static_cast<bool>(after));
  if (whole && before) LUMIGRID_CHECK(before->pixels == after->pixels);
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {seed(48, 32, base::Subsampling::k420),        seed(17, 9, base::Subsampling::k422),
          seed(8, 8, base::Subsampling::k444),          standardSeed(48, 32, base::Subsampling::k420),
          standardSeed(32, 8, base::Subsampling::k422), standardSeed(24, 16, base::Subsampling::k444)};
}

void fuzzOne(base::ByteView bytes) {
  copyUnits(bytes);
  const auto image = base::decodeJpeg(bytes, kMaxSide);
  if (!image) return;
  LUMIGRID_CHECK(image->width >= 1 && image->width <= kMaxSide && image->height >= 1 && image->height <= kMaxSide);
  LUMIGRID_CHECK_EQ(image->pixels.size(),
                    static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height) * 3);
}

}  // namespace fuzz
