// Pictures of every kind that texture files come as.
#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <cstdint>
#include <vector>

#include "base/file.h"
#include "base/png/png.h"
#include "mesh/texture.h"
#include "tests/support/temporary_directory.h"

namespace {

// Compresses an even picture of 16 x 16 pixels.
base::Bytes jpegOf(const std::vector<std::uint8_t>& color, int format, int flags) {
  const std::size_t channels = color.size();
  std::vector<std::uint8_t> pixels(16 * 16 * channels);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i] = color[i % channels];
  tjhandle handle = tjInitCompress();
  unsigned char* out = nullptr;
  unsigned long size = 0;
  const int sampling = format == TJPF_GRAY ? TJSAMP_GRAY : TJSAMP_444;
  EXPECT_EQ(tjCompress2(handle, pixels.data(), 16, 0, 16, format, &out, &size, sampling, 95, flags), 0);
  base::Bytes bytes(out, out + size);
  tjFree(out);
  tjDestroy(handle);
  return bytes;
}

void expectColor(const base::Bytes& bytes, const glm::ivec3& color) {
  const auto image = mesh::decodePicture(bytes);
  ASSERT_TRUE(image) << image.error().message;
  ASSERT_EQ(image->channels, 3);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(image->at(8, 0)[k], color[k], 3) << k;
}

TEST(Picture, jpegsOfEveryKindAreRead) {
  expectColor(jpegOf({200, 100, 50}, TJPF_RGB, 0), {200, 100, 50});
  expectColor(jpegOf({200, 100, 50}, TJPF_RGB, TJFLAG_PROGRESSIVE), {200, 100, 50});
  expectColor(jpegOf({120}, TJPF_GRAY, 0), {120, 120, 120});
  // CMYK as Adobe's programs write it: 255 is no ink.
  expectColor(jpegOf({255, 128, 0, 255}, TJPF_CMYK, 0), {255, 128, 0});
  expectColor(jpegOf({255, 255, 255, 128}, TJPF_CMYK, TJFLAG_PROGRESSIVE), {128, 128, 128});
}

// Two grey pixels of 16 bits, 0x1234 and 0xfedc.
constexpr std::uint8_t kDeepGrey[] = {
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00,
    0x00, 0x02, 0x00, 0x00, 0x00, 0x01, 0x10, 0x00, 0x00, 0x00, 0x00, 0x81, 0xd9, 0xfc, 0x15, 0x00, 0x00, 0x00,
    0x0d, 0x49, 0x44, 0x41, 0x54, 0x78, 0x9c, 0x63, 0x10, 0x32, 0xf9, 0x77, 0x07, 0x00, 0x03, 0xc1, 0x02, 0x21,
    0x0d, 0xe3, 0x47, 0x32, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};

TEST(Picture, sixteenBitsBecomeEight) {
  const auto image = mesh::decodePicture(kDeepGrey);
  ASSERT_TRUE(image) << image.error().message;
  ASSERT_EQ(image->channels, 3);
  EXPECT_NEAR(image->at(0, 0)[0], 0x12, 1);
  EXPECT_NEAR(image->at(1, 0)[0], 0xfe, 1);
  EXPECT_EQ(image->at(1, 0)[0], image->at(1, 0)[2]);
}

base::Bytes pngOf(const base::Image& image) {
  const support::TemporaryDirectory directory;
  EXPECT_TRUE(base::writePng(image, directory / "picture.png"));
  const auto bytes = base::readFile(directory / "picture.png");
  EXPECT_TRUE(bytes);
  return bytes ? *bytes : base::Bytes();
}

// Leaves stand in front of any colour, which nobody may see: not at their edges, nor in means of many pixels.
TEST(Picture, unseenPixelsTakeTheColoursOfThoseThatAreSeen) {
  base::Image leaf(37, 21, 4);
  for (int y = 0; y < leaf.height; ++y)
    for (int x = 0; x < leaf.width; ++x) {
      const bool is_seen = x < 3 || (x == 20 && y == 10);
      const glm::u8vec4 color = is_seen ? glm::u8vec4(40, 160, 30, x == 2 ? 128 : 255) : glm::u8vec4(255, 0, 255, 0);
      for (int k = 0; k < 4; ++k) leaf.at(x, y)[k] = color[k];
    }
  const base::Bytes png = pngOf(leaf);
  const auto image = mesh::decodePicture(png);
  ASSERT_TRUE(image) << image.error().message;
  ASSERT_EQ(image->channels, 4);
  for (int y = 0; y < leaf.height; ++y)
    for (int x = 0; x < leaf.width; ++x) {
      EXPECT_EQ(glm::ivec3(image->at(x, y)[0], image->at(x, y)[1], image->at(x, y)[2]), glm::ivec3(40, 160, 30))
          << x << " " << y;
      EXPECT_EQ(image->at(x, y)[3], leaf.at(x, y)[3]) << x << " " << y;
    }
  const auto texture = mesh::Texture::decode(png);
  ASSERT_TRUE(texture);
  EXPECT_EQ(texture->mean({0.5, 0.5}, 21.0), glm::u8vec4(40, 160, 30, 255));

  const auto opaque = mesh::decodePicture(png, true);
  ASSERT_TRUE(opaque);
  EXPECT_EQ(opaque->channels, 3);
  EXPECT_EQ(opaque->at(30, 5)[0], 255) << "an alpha that says nothing hides nothing";

  // Where none is seen, there is nothing to take.
  for (std::size_t i = 3; i < leaf.pixels.size(); i += 4) leaf.pixels[i] = 0;
  const auto same = mesh::decodePicture(pngOf(leaf));
  ASSERT_TRUE(same);
  EXPECT_EQ(same->pixels, leaf.pixels);
}

TEST(Picture, whatIsNoneIsRefused) {
  for (const char* text : {"", "GIF89a", "not a picture"}) {
    const auto image = mesh::decodePicture(base::viewOfText(text));
    EXPECT_FALSE(image) << text;
  }
}

}  // namespace
