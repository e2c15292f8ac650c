#include "lod/texture/page_bytes.h"

#include <gtest/gtest.h>

#include <cstring>

#include "base/crc32c.h"
#include "tests/lod/texture/texture_testing.h"

namespace lod::texture {
namespace {

using namespace texture_testing;

// docs/formats/texture.md
constexpr std::size_t kLevels = 2, kFactor = 4, kWidth = 6, kHeight = 8, kTriangles = 10, kCornerBytes = 12,
                      kAlphaBytes = 16;

Page examplePage(int channels = 3) {
  base::Image picture = smooth(120, 90, channels);
  if (channels == 4)
    for (std::size_t i = 3; i < picture.pixels.size(); i += 4) picture.pixels[i] = static_cast<std::uint8_t>(i / 7);
  std::vector<PictureTriangle> triangles = grid({3.25F, 4.0F}, {60.0F, 50.5F}, 4);
  addGrid(triangles, {70.0F, 10.0F}, {110.0F, 80.0F}, 3);
  triangles.erase(triangles.begin() + 5);
  return std::move(makePages(picture, triangles)[0]);
}

base::Bytes sealed(base::Bytes bytes) {
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).first(bytes.size() - 4));
  std::memcpy(bytes.data() + bytes.size() - 4, &crc, 4);
  return bytes;
}
template <class T>
base::Bytes withField(base::Bytes bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  return sealed(std::move(bytes));
}
std::string faultOf(const base::Bytes& bytes) {
  const auto page = decodePage(bytes);
  return page ? "" : page.error().message;
}
void expectFault(const base::Bytes& bytes, const std::string& words) {
  EXPECT_NE(faultOf(bytes).find(words), std::string::npos) << faultOf(bytes);
}

TEST(PageBytes, aPageComesBackWithinTheErrorOfItsJpeg) {
  for (const int channels : {3, 4}) {
    const Page page = examplePage(channels);
    ASSERT_EQ(page.image.channels, channels);
    const auto bytes = encodePage(page);
    ASSERT_TRUE(bytes) << bytes.error().message;
    const auto back = decodePage(*bytes);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->triangles, page.triangles);
    EXPECT_EQ(back->levels, page.levels);
    EXPECT_EQ(back->scale, page.scale);
    ASSERT_EQ(back->image.width, page.image.width);
    ASSERT_EQ(back->image.channels, channels);
    for (std::size_t i = 0; i < page.image.pixels.size(); ++i) {
      const bool alpha = channels == 4 && i % 4 == 3;
      ASSERT_NEAR(back->image.pixels[i], page.image.pixels[i], alpha ? 0 : 12) << i;
    }
  }
}

TEST(PageBytes, theSamePageGivesTheSameBytes) {
  EXPECT_EQ(*encodePage(examplePage(4), 80), *encodePage(examplePage(4), 80));
}

TEST(PageBytes, aCornerTakesTwoBytesAtMost) {
  base::Image picture(1000, 1000, 3);
  const auto pages = makePages(picture, grid({1.3F, 2.7F}, {931.1F, 871.3F}, 40));
  ASSERT_EQ(pages.size(), 1U);
  const auto bytes = encodePage(pages[0]);
  EXPECT_LT(readPageHeader(*bytes)->corner_bytes, 2U * 3U * 3200U);
}

TEST(PageBytes, aReducedPageKeepsItsScale) {
  const auto pages = makePages(smooth(700, 64), grid({0.0F, 0.0F}, {700.0F, 64.0F}, 2), 256);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(decodePage(*encodePage(pages[0]))->scale, 1.0F / 3.0F);
}

TEST(PageBytes, pagesThatCouldNotBeReadAreNotWritten) {
  const Page good = examplePage();
  EXPECT_TRUE(encodePage(good));
  Page page = good;
  page.levels = 0;
  EXPECT_FALSE(encodePage(page));
  page = good;
  page.triangles.clear();
  EXPECT_FALSE(encodePage(page));
  page = good;
  page.triangles[1].triangle = page.triangles[0].triangle;
  EXPECT_FALSE(encodePage(page));
  page = good;
  page.triangles[1].corners[2].x = static_cast<std::uint16_t>(page.image.width * kCornerSteps + 1);
  EXPECT_FALSE(encodePage(page));
  for (const float scale : {0.0F, -1.0F, 0.7F, 2.0F, std::numeric_limits<float>::quiet_NaN()}) {
    page = good;
    page.scale = scale;
    EXPECT_FALSE(encodePage(page)) << scale;
  }
  page = good;
  page.image = base::Image(30, 32, 3);
  EXPECT_FALSE(encodePage(page));
  page.image = base::Image();
  EXPECT_FALSE(encodePage(page));
}

TEST(PageBytes, everyCutIsRefused) {
  const base::Bytes bytes = *encodePage(examplePage(4));
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const auto cut = base::ByteView(bytes).first(length);
    ASSERT_FALSE(decodePage(cut)) << length;
    if (length < 4) continue;
    ASSERT_FALSE(decodePage(sealed(base::Bytes(cut.begin(), cut.end())))) << length;
  }
  base::Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(decodePage(sealed(longer)));
}

TEST(PageBytes, everyFlippedByteIsNoticed) {
  base::Bytes bytes = *encodePage(examplePage(4));
  for (std::uint8_t& byte : bytes) {
    byte ^= 0x21;
    ASSERT_FALSE(decodePage(bytes)) << &byte - bytes.data();
    byte ^= 0x21;
  }
}

TEST(PageBytes, eachWrongNumberInTheHeaderIsNamed) {
  const base::Bytes bytes = *encodePage(examplePage(4));
  const auto newer = decodePage(withField<std::uint8_t>(bytes, 0, 2));
  ASSERT_FALSE(newer);
  EXPECT_EQ(newer.error().code, base::ErrorCode::kVersion);
  expectFault(withField<std::uint8_t>(bytes, 1, 3), "unknown flags");
  expectFault(withField<std::uint8_t>(bytes, 1, 0), "alpha is missing");
  expectFault(withField<std::uint8_t>(bytes, kLevels, 0), "levels");
  expectFault(withField<std::uint8_t>(bytes, kLevels, 15), "levels");
  expectFault(withField<std::uint8_t>(bytes, kLevels + 1, 1), "unknown flags");
  expectFault(withField<std::uint16_t>(bytes, kFactor, 0), "scale");
  expectFault(withField<std::uint16_t>(bytes, kWidth, 10), "sides");
  expectFault(withField<std::uint16_t>(bytes, kWidth, 512), "another size");
  expectFault(withField<std::uint16_t>(bytes, kHeight, 8196), "sides");
  expectFault(withField<std::uint16_t>(bytes, kTriangles, 0), "no triangles");
  expectFault(withField<std::uint16_t>(bytes, kTriangles, 65535), "triangles cannot be read");
  expectFault(withField<std::uint32_t>(bytes, kCornerBytes, 0xFFFFFFFF), "add up");
  expectFault(withField<std::uint32_t>(bytes, kAlphaBytes, 3), "add up");
}

// A few bytes must not ask for hundreds of megabytes.
TEST(PageBytes, aSizeThatItsBytesCannotFillIsRefused) {
  base::Bytes bytes = *encodePage(examplePage());
  bytes = withField<std::uint16_t>(bytes, kWidth, 8192);
  expectFault(withField<std::uint16_t>(bytes, kHeight, 8192), "too short for its size");

  // JPEG's own header has its size behind the marker FFC0.
  base::Bytes forged = *encodePage(examplePage());
  const std::array<std::uint8_t, 2> marker{0xFF, 0xC0};
  const auto frame = std::search(forged.begin(), forged.end(), marker.begin(), marker.end());
  ASSERT_NE(frame, forged.end());
  for (int i = 5; i < 9; i += 2) frame[i] = 0x20;
  expectFault(sealed(forged), "another size");
}

TEST(PageBytes, aConstantPageOfFullSizeComesBack) {
  Page page;
  page.image = base::Image(2048, 2048, 3);
  page.triangles.push_back({65535, {glm::u16vec2(0, 0), glm::u16vec2(16384, 0), glm::u16vec2(0, 16384)}});
  const auto back = decodePage(*encodePage(page, 1));
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->triangles, page.triangles);
}

}  // namespace
}  // namespace lod::texture
