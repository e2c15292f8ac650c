// Pictures of every kind that texture files come as.
#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <cstdint>
#include <vector>

#include "mesh/texture.h"

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

TEST(Picture, whatIsNoneIsRefused) {
  for (const char* text : {"", "GIF89a", "not a picture"}) {
    const auto image = mesh::decodePicture(base::viewOfText(text));
    EXPECT_FALSE(image) << text;
  }
}

}  // namespace
