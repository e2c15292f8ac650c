#include "base/png/png.h"

#include <gtest/gtest.h>
#include <png.h>

#include <array>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace base {
namespace {

class PngTest : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return directory_ / name; }
  const support::TemporaryDirectory directory_;
};

// Every byte differs from its neighbours, alpha included.
Image pattern(int width, int height, int channels) {
  Image image(width, height, channels);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<std::uint8_t>(i * 37 + i / 7);
  return image;
}

TEST_F(PngTest, pixelsComeBackAsTheyWere) {
  for (const int channels : {1, 3, 4}) {
    const Image image = pattern(13, 5, channels);
    ASSERT_TRUE(writePng(image, path("a.png")));
    const auto again = readPng(path("a.png"));
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(again->width, 13);
    EXPECT_EQ(again->height, 5);
    EXPECT_EQ(again->channels, channels);
    EXPECT_EQ(again->pixels, image.pixels) << channels << " channels";
  }
}

TEST_F(PngTest, onePixelIsAPicture) {
  const Image image = pattern(1, 1, 4);
  ASSERT_TRUE(writePng(image, path("one.png")));
  const auto again = readPng(path("one.png"));
  ASSERT_TRUE(again);
  EXPECT_EQ(again->pixels, image.pixels);
}

TEST_F(PngTest, paletteIsExpandedToRgb) {
  // The file has two pixels and a palette of red and blue.
  const std::array<std::uint8_t, 2> indices{1, 0};
  const std::array<std::uint8_t, 6> palette{255, 0, 0, 0, 0, 255};
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = 2;
  png.height = 1;
  png.format = PNG_FORMAT_RGB_COLORMAP;
  png.colormap_entries = 2;
  ASSERT_NE(png_image_write_to_file(&png, path("palette.png").c_str(), 0, indices.data(), 0, palette.data()), 0);
  const auto image = readPng(path("palette.png"));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->channels, 3);
  EXPECT_EQ(image->pixels, (std::vector<std::uint8_t>{0, 0, 255, 255, 0, 0}));
}

TEST_F(PngTest, truncatedAtAnyLengthIsAnErrorThatNamesTheFile) {
  ASSERT_TRUE(writePng(pattern(9, 9, 3), path("whole.png")));
  const auto whole = readFile(path("whole.png"));
  ASSERT_TRUE(whole);
  // The last 12 bytes are the end chunk, which libpng forgives.
  for (std::size_t length = 0; length + 12 < whole->size(); ++length) {
    ASSERT_TRUE(writeFileAtomically(path("cut.png"), ByteView(*whole).first(length)));
    const auto image = readPng(path("cut.png"));
    ASSERT_FALSE(image) << length << " of " << whole->size() << " bytes";
    EXPECT_NE(image.error().message.find("cut.png"), std::string::npos) << image.error().message;
  }
}

TEST_F(PngTest, anyByteChangedNeverCrashes) {
  ASSERT_TRUE(writePng(pattern(9, 9, 4), path("whole.png")));
  const auto whole = readFile(path("whole.png"));
  ASSERT_TRUE(whole);
  int errors = 0;
  for (std::size_t i = 0; i < whole->size(); ++i) {
    Bytes bytes = *whole;
    bytes[i] ^= 0x55;
    ASSERT_TRUE(writeFileAtomically(path("bad.png"), bytes));
    if (!readPng(path("bad.png"))) ++errors;
  }
  EXPECT_GT(errors, 20);
}

TEST_F(PngTest, headerThatClaimsMoreThanItsBytesCanHoldIsRefusedBeforeAllocating) {
  ASSERT_TRUE(writePng(pattern(9, 9, 1), path("small.png")));
  auto bytes = readFile(path("small.png"));
  ASSERT_TRUE(bytes);
  // IHDR: length 4, "IHDR" 4, width and height big-endian from byte 16; its CRC (bytes 29–32) made right again.
  for (const std::size_t at : {std::size_t{17}, std::size_t{21}}) (*bytes)[at] = 1;  // 65536 + 9 each
  const std::uint32_t crc = [&] {
    std::uint32_t c = 0xFFFFFFFFU;
    for (std::size_t i = 12; i < 29; ++i) {
      c ^= (*bytes)[i];
      for (int k = 0; k < 8; ++k) c = (c & 1U) != 0 ? 0xEDB88320U ^ (c >> 1) : c >> 1;
    }
    return c ^ 0xFFFFFFFFU;
  }();
  for (std::size_t i = 0; i < 4; ++i) (*bytes)[29 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  ASSERT_TRUE(writeFileAtomically(path("forged.png"), *bytes));
  const auto image = readPng(path("forged.png"));
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("65545 x 65545"), std::string::npos) << image.error().message;
}

TEST_F(PngTest, missingFileAndMissingFolderAreErrors) {
  const auto absent = readPng(path("absent.png"));
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(writePng(pattern(2, 2, 3), path("no/such/folder/a.png")));
}

}  // namespace
}  // namespace base
