// Blocks of a JPEG move to another JPEG without loss.
#include "base/jpeg/blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
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
