#include "base/jpeg/jpeg.h"

#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <random>
#include <thread>
#include <vector>

namespace base {
namespace {

Image smoothImage(int width, int height) {
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at(x, y)[0] = static_cast<std::uint8_t>(127.0 + 100.0 * std::sin(0.05 * x));
      image.at(x, y)[1] = static_cast<std::uint8_t>(127.0 + 100.0 * std::cos(0.04 * y));
      image.at(x, y)[2] = static_cast<std::uint8_t>(x + y);
    }
  }
  return image;
}

double meanDifference(const Image& a, const Image& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += std::abs(int{a.pixels[i]} - int{b.pixels[i]});
  return sum / static_cast<double>(a.pixels.size());
}

TEST(Jpeg, aPictureComesBackNearlyTheSame) {
  const Image image = smoothImage(200, 120);
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k422, Subsampling::k444}) {
    const auto bytes = encodeJpeg(image, 92, subsampling);
    ASSERT_TRUE(bytes) << bytes.error().message;
    const auto back = decodeJpeg(*bytes);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(back->width, 200);
    EXPECT_EQ(back->height, 120);
    EXPECT_EQ(back->channels, 3);
    EXPECT_LT(meanDifference(image, *back), 4.0);
  }
}

TEST(Jpeg, higherQualityCostsBytesAndComesNearer) {
  const Image image = smoothImage(256, 256);
  const auto low = encodeJpeg(image, 20, Subsampling::k444);
  const auto high = encodeJpeg(image, 95, Subsampling::k444);
  ASSERT_TRUE(low && high);
  EXPECT_LT(low->size(), high->size());
  EXPECT_LT(meanDifference(image, *decodeJpeg(*high)), meanDifference(image, *decodeJpeg(*low)));
}

// Encodes with TurboJPEG, which uses the standard Huffman tables.
Bytes withStandardTables(const Image& rgb, int quality, int samples) {
  void* handle = tjInitCompress();
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  EXPECT_EQ(tjCompress2(handle, rgb.pixels.data(), rgb.width, 0, rgb.height, TJPF_RGB, &bytes, &size, samples, quality,
                        TJFLAG_ACCURATEDCT),
            0);
  Bytes all(bytes, bytes + size);
  tjFree(bytes);
  tjDestroy(handle);
  return all;
}

TEST(Jpeg, ownTablesSaveBytesAndChangeNoPixel) {
  const Image image = smoothImage(203, 121);
  const std::pair<Subsampling, int> pairs[] = {
      {Subsampling::k420, TJSAMP_420}, {Subsampling::k422, TJSAMP_422}, {Subsampling::k444, TJSAMP_444}};
  for (const auto& [ours, theirs] : pairs) {
    for (const int quality : {1, 30, 85, 96, 100}) {
      const Bytes standard = withStandardTables(image, quality, theirs);
      const auto own = encodeJpeg(image, quality, ours);
      ASSERT_TRUE(own);
      EXPECT_LT(own->size() * 10, standard.size() * 9);
      EXPECT_EQ(decodeJpeg(*own)->pixels, decodeJpeg(standard)->pixels) << quality;
    }
  }
}

TEST(Jpeg, aPictureTooLargeForTheFormatIsAnError) {
  const auto bytes = encodeJpeg(Image(65501, 1, 3), 85, Subsampling::k420);
  ASSERT_FALSE(bytes);
  EXPECT_NE(bytes.error().message.find("65500"), std::string::npos) << bytes.error().message;
}

TEST(Jpeg, oddSizesAndOnePixelWork) {
  for (const auto& [w, h] : {std::pair{1, 1}, {7, 3}, {17, 33}}) {
    const auto bytes = encodeJpeg(smoothImage(w, h), 85, Subsampling::k420);
    ASSERT_TRUE(bytes);
    const auto back = decodeJpeg(*bytes);
    ASSERT_TRUE(back);
    EXPECT_EQ(back->width, w);
    EXPECT_EQ(back->height, h);
  }
}

TEST(Jpeg, theSamePictureGivesTheSameBytesFromEveryThread) {
  const Image image = smoothImage(128, 128);
  const auto expected = encodeJpeg(image, 85, Subsampling::k420);
  ASSERT_TRUE(expected);
  std::atomic<int> equal{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 5; ++i) {
        const auto bytes = encodeJpeg(image, 85, Subsampling::k420);
        const auto back = bytes ? decodeJpeg(*bytes) : bytes.error();
        equal += bytes && *bytes == *expected && back ? 1 : 0;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(equal, 20);
}

TEST(Jpeg, everyTruncationIsRefused) {
  const auto bytes = encodeJpeg(smoothImage(40, 40), 85, Subsampling::k420);
  ASSERT_TRUE(bytes);
  // libjpeg only warns when the end marker (the last two bytes) or any part of the data is missing.
  for (std::size_t size = 0; size < bytes->size(); ++size)
    EXPECT_FALSE(decodeJpeg(ByteView(*bytes).first(size))) << size;
}

TEST(Jpeg, bytesThatAreNoJpegAreRefused) {
  std::mt19937 random(3);
  Bytes bytes(500);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  EXPECT_FALSE(decodeJpeg(bytes));
  bytes[0] = 0xFF, bytes[1] = 0xD8;
  EXPECT_FALSE(decodeJpeg(bytes));
  EXPECT_FALSE(decodeJpeg({}));
}

TEST(Jpeg, flippedBitsNeverCrashAndADecoderRecoversAfterThem) {
  const auto good = encodeJpeg(smoothImage(64, 64), 85, Subsampling::k420);
  ASSERT_TRUE(good);
  std::mt19937 random(5);
  for (int i = 0; i < 500; ++i) {
    Bytes bytes = *good;
    for (int flips = 0; flips < 3; ++flips)
      bytes[random() % bytes.size()] ^= static_cast<std::uint8_t>(1U << random() % 8);
    const auto decoded = decodeJpeg(bytes, 256);
    if (decoded) {
      EXPECT_LE(decoded->width, 256);
    }
  }
  EXPECT_TRUE(decodeJpeg(*good));
}

TEST(Jpeg, aPictureLargerThanAllowedIsRefusedBeforeItIsDecoded) {
  const auto bytes = encodeJpeg(smoothImage(300, 20), 85, Subsampling::k420);
  ASSERT_TRUE(bytes);
  EXPECT_EQ(readJpegSize(*bytes)->width, 300);
  EXPECT_EQ(readJpegSize(*bytes)->height, 20);
  EXPECT_TRUE(decodeJpeg(*bytes, 300));
  const auto refused = decodeJpeg(*bytes, 299);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("300 x 20"), std::string::npos);
}

// A picture encoded row by row with the standard tables has the same pixels as one encoded whole with its own tables.
TEST(JpegRows, anyDivisionIntoRowsGivesTheSamePicture) {
  const Image image = smoothImage(117, 61);
  for (const Subsampling subsampling : {Subsampling::k420, Subsampling::k444}) {
    const auto whole = decodeJpeg(*encodeJpeg(image, 85, subsampling));
    ASSERT_TRUE(whole);
    for (const int rows : {1, 7, 16, 61}) {
      Bytes bytes;
      auto jpeg = beginJpeg(image.width, image.height, 85, subsampling, bytes);
      ASSERT_TRUE(jpeg);
      for (int y = 0; y < image.height; y += rows) {
        Image part(image.width, std::min(rows, image.height - y), 3);
        std::copy_n(image.at(0, y), part.pixels.size(), part.pixels.begin());
        ASSERT_TRUE((*jpeg)->add(part));
      }
      const auto read = decodeJpeg(bytes);
      ASSERT_TRUE(read) << read.error().message;
      EXPECT_TRUE(read->pixels == whole->pixels) << rows << " rows at a time";
    }
  }
}

TEST(JpegRows, sidesTooLargeForJpegAreAnError) {
  Bytes bytes;
  EXPECT_FALSE(beginJpeg(70'000, 1, 85, Subsampling::k420, bytes));
}

}  // namespace
}  // namespace base
