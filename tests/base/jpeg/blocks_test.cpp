// Blocks of a JPEG move to another JPEG without loss.
#include "base/jpeg/blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "base/jpeg/jpeg.h"

namespace base {
namespace {

constexpr std::uint64_t kPlenty = std::uint64_t{1} << 30;

Image noisy(int width, int height) {
  Image image(width, height, 3);
  std::mt19937 random(5);
  for (std::size_t i = 0; i < image.pixels.size(); ++i)
    image.pixels[i] = static_cast<std::uint8_t>(100 + (i / 40) % 60 + random() % 40);
  return image;
}

TEST(JpegBlocks, aRectangleOfUnitsDecodesToTheSamePixels) {
  const Image image = noisy(100, 70);
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444}) {
    const auto jpeg = encodeJpeg(image, 85, subsampling);
    ASSERT_TRUE(jpeg);
    const auto blocks = JpegBlocks::read(*jpeg, kPlenty);
    ASSERT_TRUE(blocks) << blocks.error().message;
    EXPECT_EQ(blocks->width(), 100);
    EXPECT_EQ(blocks->height(), 70);
    ASSERT_EQ(blocks->planes(), 3);
    EXPECT_EQ(blocks->unitWidth(), subsampling == Subsampling::k444 ? 8 : 16);
    EXPECT_EQ(blocks->unitHeight(), subsampling == Subsampling::k420 ? 16 : 8);

    // The units from (16, 16) on, 48 x 32 pixels.
    const int wide = 48 / blocks->unitWidth(), high = 32 / blocks->unitHeight();
    const auto cut = blocks->encode(wide, high, [&](int x, int y, JpegBlock*) -> std::optional<std::array<int, 2>> {
      return std::array{x + 16 / blocks->unitWidth(), y + 16 / blocks->unitHeight()};
    });
    ASSERT_TRUE(cut) << cut.error().message;
    const auto whole = decodeJpeg(*jpeg), part = decodeJpeg(*cut);
    ASSERT_TRUE(whole && part);
    ASSERT_EQ(part->width, 48);
    ASSERT_EQ(part->height, 32);
    // At the edges coarser colours have no neighbours to be mixed with.
    for (int y = 1; y < 31; ++y)
      for (int x = 1; x < 47; ++x)
        for (int c = 0; c < 3; ++c) ASSERT_EQ(part->at(x, y)[c], whole->at(x + 16, y + 16)[c]) << x << ' ' << y;
  }
}

// A JPEG with the standard's tables, or with its own.
Bytes evenJpeg(bool own_tables) {
  Bytes bytes;
  auto rows = beginJpeg(64, 64, 90, Subsampling::k444, bytes, own_tables);
  EXPECT_TRUE(rows && (*rows)->add(Image(64, 64, 3)));
  return bytes;
}

TEST(JpegBlocks, anyBlocksComeBackFromJpegsWithAnyTables) {
  std::mt19937 random(2);
  std::vector<JpegBlock> given(3 * 4 * 4);
  for (JpegBlock& block : given)
    for (std::int16_t& value : block)
      value = static_cast<std::int16_t>(random() % 3 == 0 ? static_cast<int>(random() % 2047) - 1023 : 0);
  const auto fill = [&](int x, int y, JpegBlock* blocks) -> std::optional<std::array<int, 2>> {
    for (int plane = 0; plane < 3; ++plane) blocks[plane] = given[static_cast<std::size_t>(16 * plane + 4 * y + x)];
    return std::nullopt;
  };
  // Tables of an even picture know even blocks only.
  for (const bool own_tables : {false, true}) {
    const auto blocks = JpegBlocks::read(evenJpeg(own_tables), kPlenty);
    ASSERT_TRUE(blocks) << blocks.error().message;
    const auto made = blocks->encode(4, 4, fill);
    ASSERT_TRUE(made) << made.error().message;
    const auto back = JpegBlocks::read(*made, kPlenty);
    ASSERT_TRUE(back) << back.error().message;
    for (int plane = 0; plane < 3; ++plane)
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x)
          EXPECT_EQ(back->block(plane, x, y), given[static_cast<std::size_t>(16 * plane + 4 * y + x)]);
  }
}

// The same picture with the standard's tables, so that units stay coded.
Bytes standardJpeg(const Image& image, int quality, Subsampling subsampling) {
  Bytes bytes;
  auto rows = beginJpeg(image.width, image.height, quality, subsampling, bytes, false);
  EXPECT_TRUE(rows && (*rows)->add(image));
  return bytes;
}

// With tables of its own a JPEG is decoded by libjpeg, and this one's blocks are the same.
TEST(JpegBlocks, thatStayCodedAreThoseThatLibjpegDecodes) {
  const Image image = noisy(203, 131);
  for (const int quality : {40, 85, 100})
    for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444}) {
      const auto coded = JpegBlocks::read(standardJpeg(image, quality, subsampling), kPlenty);
      const auto decoded = JpegBlocks::read(*encodeJpeg(image, quality, subsampling), kPlenty);
      ASSERT_TRUE(coded && decoded);
      for (int p = 0; p < 3; ++p) {
        const JpegPlane& plane = decoded->plane(p);
        EXPECT_EQ(coded->plane(p).quant, plane.quant);
        ASSERT_EQ(coded->plane(p).wide, plane.wide);
        ASSERT_EQ(coded->plane(p).high, plane.high);
        for (int y = 0; y < plane.high; ++y)
          for (int x = 0; x < plane.wide; ++x) {
            ASSERT_EQ(coded->block(p, x, y), decoded->block(p, x, y)) << p << ' ' << x << ' ' << y;
            ASSERT_EQ(coded->mean(p, x, y), decoded->block(p, x, y)[0]);
          }
      }
      std::array<JpegBlock, 3> one{}, other{};
      for (const auto& [x, y] : {std::pair(0, 0), std::pair(202, 130), std::pair(90, 41)}) {
        coded->blocksAt(x, y, one);
        decoded->blocksAt(x, y, other);
        EXPECT_EQ(one, other);
        EXPECT_EQ(one[0], decoded->block(0, x / 8, y / 8));
      }
    }
}

// Units that are copied and such that are made alternate, in runs of several lengths.
TEST(JpegBlocks, thatStayCodedAreCopiedInAnyOrder) {
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444}) {
    const Image image = noisy(160, 96);
    const auto coded = JpegBlocks::read(standardJpeg(image, 90, subsampling), kPlenty);
    const auto decoded = JpegBlocks::read(*encodeJpeg(image, 90, subsampling), kPlenty);
    ASSERT_TRUE(coded && decoded);
    const int wide = 160 / coded->unitWidth(), high = 96 / coded->unitHeight();
    const int down = coded->plane(0).down, across = coded->plane(0).across, blocks = across * down + 2;
    const auto unit = [&](int x, int y, JpegBlock* out) -> std::optional<std::array<int, 2>> {
      std::mt19937 random(static_cast<unsigned>(x / 3 + 100 * y));
      if (random() % 4 != 0) return std::array{(x + static_cast<int>(random() % 3)) % wide, (7 * y + 3) % high};
      for (int b = 0; b < blocks; ++b) {
        out[b].fill(0);
        out[b][0] = static_cast<std::int16_t>(static_cast<int>(random() % 2048) - 1024);
        for (unsigned i = 1; i < random() % 64; ++i)
          out[b][i] = static_cast<std::int16_t>(static_cast<int>(random() % 2047) - 1023);
      }
      return std::nullopt;
    };
    const auto copied = coded->encode(wide, high, unit), written = decoded->encode(wide, high, unit);
    ASSERT_TRUE(copied && written);
    const auto one = decodeJpeg(*copied), other = decodeJpeg(*written);
    ASSERT_TRUE(one && other);
    EXPECT_EQ(one->pixels, other->pixels);
    const auto back = JpegBlocks::read(*copied, kPlenty), known = JpegBlocks::read(*written, kPlenty);
    ASSERT_TRUE(back && known);
    for (int p = 0; p < 3; ++p)
      for (int y = 0; y < known->plane(p).high; ++y)
        for (int x = 0; x < known->plane(p).wide; ++x) ASSERT_EQ(back->block(p, x, y), known->block(p, x, y));
  }
}

TEST(JpegBlocks, ofAWholePictureAreItsBytes) {
  const Bytes jpeg = standardJpeg(noisy(96, 64), 90, Subsampling::k420);
  const auto blocks = JpegBlocks::read(jpeg, kPlenty);
  ASSERT_TRUE(blocks);
  const auto copy = blocks->encode(6, 4, [](int x, int y, JpegBlock*) { return std::optional(std::array{x, y}); });
  ASSERT_TRUE(copy);
  EXPECT_EQ(*copy, jpeg);
}

// How far a picture is from the means of another one over 4 x 4 pixels, levels: the mean over whole squares.
double offFromMeans(const Image& quarter, const Image& whole) {
  double sum = 0.0;
  for (int y = 0; y < quarter.height; ++y)
    for (int x = 0; x < quarter.width; ++x)
      for (int c = 0; c < 3; ++c) {
        double mean = 0.0;
        for (int i = 0; i < 16; ++i) mean += whole.at(4 * x + i % 4, 4 * y + i / 4)[c] / 16.0;
        sum += std::abs(mean - quarter.at(x, y)[c]);
      }
  return sum / (3.0 * quarter.width * quarter.height);
}

TEST(JpegBlocks, aQuarterIsTheMeanOverSquaresOfFourPixels) {
  const Image noise = noisy(203, 131);
  // Bright and dark squares in three colours, whose edges lie inside blocks, with soft slopes between them.
  Image squares(203, 131, 3);
  for (int y = 0; y < squares.height; ++y)
    for (int x = 0; x < squares.width; ++x)
      for (int c = 0; c < 3; ++c)
        squares.at(x, y)[c] = static_cast<std::uint8_t>(
            127.5 + 127.0 * std::clamp(3.0 * std::sin(0.11 * x + c) * std::sin(0.07 * y + 2.0 * c), -1.0, 1.0));
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444})
    for (const Image* image : {&noise, static_cast<const Image*>(&squares)}) {
      const Bytes jpeg = standardJpeg(*image, 95, subsampling);
      const auto quarter = JpegBlocks::readQuarter(jpeg, kPlenty);
      ASSERT_TRUE(quarter);
      ASSERT_EQ(quarter->picture.width, 50);
      ASSERT_EQ(quarter->picture.height, 32);
      // libjpeg mixes coarser colours with those beside them, and the highest frequencies of brightness are left out.
      const bool plain = subsampling == Subsampling::k444 && image == &squares;
      EXPECT_LT(offFromMeans(quarter->picture, *decodeJpeg(jpeg)), plain ? 0.7 : 1.5) << nameOf(subsampling);
    }
  const auto narrow = JpegBlocks::readQuarter(standardJpeg(noisy(3, 9), 90, Subsampling::k420), kPlenty);
  ASSERT_TRUE(narrow);
  EXPECT_EQ(narrow->picture.width, 1);
  EXPECT_EQ(narrow->picture.height, 2);
}

TEST(JpegBlocks, aQuarterIsMadeOfJpegsThatStayCodedAndNoOthers) {
  EXPECT_FALSE(JpegBlocks::readQuarter(*encodeJpeg(noisy(64, 64), 80, Subsampling::k420), kPlenty));
  const Bytes jpeg = standardJpeg(noisy(64, 64), 80, Subsampling::k420);
  for (std::size_t length = 0; length + 2 < jpeg.size(); length += 7)
    EXPECT_FALSE(JpegBlocks::readQuarter(ByteView(jpeg).first(length), kPlenty)) << length;
  EXPECT_FALSE(JpegBlocks::readQuarter(jpeg, 1000));
  EXPECT_FALSE(JpegBlocks::readQuarter({}, kPlenty));
}

TEST(JpegBlocks, areTheSameWithUnitsThatWereFoundBeforeAndWithWrongOnes) {
  const Bytes jpeg = standardJpeg(noisy(160, 96), 90, Subsampling::k420);
  const auto known = JpegBlocks::readQuarter(jpeg, kPlenty);
  const auto other = JpegBlocks::readQuarter(standardJpeg(noisy(160, 96), 91, Subsampling::k420), kPlenty);
  ASSERT_TRUE(known && other);
  Bytes broken = known->units;
  broken.pop_back();
  const auto expected = JpegBlocks::read(jpeg, kPlenty);
  ASSERT_TRUE(expected);
  for (const Bytes& units : {known->units, other->units, broken, Bytes()}) {
    const auto blocks = JpegBlocks::read(jpeg, kPlenty, units);
    ASSERT_TRUE(blocks);
    for (int p = 0; p < 3; ++p)
      for (int y = 0; y < expected->plane(p).high; ++y)
        for (int x = 0; x < expected->plane(p).wide; ++x) {
          ASSERT_EQ(blocks->block(p, x, y), expected->block(p, x, y));
          ASSERT_EQ(blocks->mean(p, x, y), expected->mean(p, x, y));
        }
    const auto copy = blocks->encode(10, 6, [](int x, int y, JpegBlock*) { return std::optional(std::array{x, y}); });
    ASSERT_TRUE(copy);
    EXPECT_EQ(*copy, jpeg);
  }
}

TEST(JpegBlocks, areTheSameUnitByUnit) {
  // 101 x 70 pixels: the last units reach beyond the picture. With tables of its own a JPEG does not stay coded.
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444})
    for (const Bytes& jpeg :
         {standardJpeg(noisy(101, 70), 85, subsampling), *encodeJpeg(noisy(101, 70), 85, subsampling)}) {
      const auto blocks = JpegBlocks::read(jpeg, kPlenty);
      ASSERT_TRUE(blocks);
      std::array<JpegBlock, JpegBlocks::kMostInUnit> unit;
      for (int y = 0; y * blocks->unitHeight() < 70; ++y)
        for (int x = 0; x * blocks->unitWidth() < 101; ++x) {
          blocks->unitBlocks(x, y, unit);
          std::size_t next = 0;
          for (int p = 0; p < 3; ++p) {
            const JpegPlane& plane = blocks->plane(p);
            for (int j = y * plane.down; j < (y + 1) * plane.down; ++j)
              for (int i = x * plane.across; i < (x + 1) * plane.across; ++i, ++next) {
                if (i >= plane.wide || j >= plane.high) continue;
                ASSERT_EQ(unit[next], blocks->block(p, i, j)) << p << ' ' << i << ' ' << j;
              }
          }
        }
    }
}

TEST(JpegBlocks, thatStayCodedAreRefusedWhereTheyAreBroken) {
  const Bytes jpeg = standardJpeg(noisy(64, 64), 80, Subsampling::k420);
  for (std::size_t length = 0; length + 2 < jpeg.size(); length += 7)
    EXPECT_FALSE(JpegBlocks::read(ByteView(jpeg).first(length), kPlenty)) << length;
  // Data that goes on behind the last unit, as libjpeg warns of.
  Bytes longer = jpeg;
  longer.insert(longer.end() - 2, 40, 0x55);
  EXPECT_FALSE(JpegBlocks::read(longer, kPlenty));
  const auto tooMany = JpegBlocks::read(jpeg, 1000);
  ASSERT_FALSE(tooMany);
  EXPECT_EQ(tooMany.error().code, ErrorCode::kUnsupported);
}

TEST(JpegBlocks, brokenOrOtherBytesAreRefused) {
  const auto jpeg = encodeJpeg(noisy(64, 64), 80, Subsampling::k420);
  ASSERT_TRUE(jpeg);
  for (std::size_t length = 0; length + 2 < jpeg->size(); length += 7) {
    const auto blocks = JpegBlocks::read(ByteView(*jpeg).first(length), kPlenty);
    ASSERT_FALSE(blocks) << length;
    EXPECT_EQ(blocks.error().code, ErrorCode::kInvalidInput);
  }
  // 64 blocks of one plane and 16 of each of the others, 128 bytes each.
  EXPECT_TRUE(JpegBlocks::read(*jpeg, 128 * 96));
  const auto tooMany = JpegBlocks::read(*jpeg, 128 * 96 - 1);
  ASSERT_FALSE(tooMany);
  EXPECT_EQ(tooMany.error().code, ErrorCode::kUnsupported);
}

}  // namespace
}  // namespace base
