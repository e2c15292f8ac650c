#include "repository/faces/face_value.h"

#include <gtest/gtest.h>

#include "base/crc32c.h"

namespace repository {
namespace {

const base::Bytes kJpeg = {0xFF, 0xD8, 1, 2, 3, 0xFF, 0xD9};
const base::Bytes kCoverage = {1, 9, 8, 7};

FaceValue imageValue() {
  return {false, kJpeg, kCoverage};
}

TEST(FaceValue, imageAndMaskComeBack) {
  const base::Bytes bytes = encodeFaceValue(imageValue());
  EXPECT_EQ(bytes.size(), 16 + kJpeg.size() + kCoverage.size());
  const auto value = decodeFaceValue(bytes);
  ASSERT_TRUE(value) << value.error().message;
  EXPECT_FALSE(value->empty);
  EXPECT_EQ(base::Bytes(value->picture.begin(), value->picture.end()), kJpeg);
  EXPECT_EQ(base::Bytes(value->coverage.begin(), value->coverage.end()), kCoverage);
}

TEST(FaceValue, aFullMaskTakesNoBytes) {
  const base::Bytes bytes = encodeFaceValue({false, kJpeg, {}});
  const auto value = decodeFaceValue(bytes);
  ASSERT_TRUE(value);
  EXPECT_TRUE(value->coverage.empty());
  EXPECT_EQ(bytes.size(), 16 + kJpeg.size());
}

TEST(FaceValue, anEmptyFlagIsEightBytes) {
  const base::Bytes bytes = encodeFaceValue({});
  EXPECT_EQ(bytes.size(), 8U);
  const auto value = decodeFaceValue(bytes);
  ASSERT_TRUE(value);
  EXPECT_TRUE(value->empty);
}

TEST(FaceValue, everyTruncationIsRefused) {
  for (const base::Bytes& bytes : {encodeFaceValue(imageValue()), encodeFaceValue({})}) {
    for (std::size_t size = 0; size < bytes.size(); ++size)
      EXPECT_FALSE(decodeFaceValue(base::ByteView(bytes).first(size))) << size;
  }
}

TEST(FaceValue, bytesBehindTheEndAreRefused) {
  for (base::Bytes bytes : {encodeFaceValue(imageValue()), encodeFaceValue({})}) {
    bytes.push_back(0);
    EXPECT_FALSE(decodeFaceValue(bytes));
  }
}

TEST(FaceValue, everyFlippedBitIsRefused) {
  for (const base::Bytes& good : {encodeFaceValue(imageValue()), encodeFaceValue({})}) {
    for (std::size_t bit = 0; bit < 8 * good.size(); ++bit) {
      base::Bytes bytes = good;
      bytes[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
      EXPECT_FALSE(decodeFaceValue(bytes)) << bit;
    }
  }
}

// The lengths are wrong, but the checksum fits. The layout is 4 header bytes, CRC, JPEG length, mask length, bytes.
TEST(FaceValue, wrongLengthsUnderAValidChecksumAreRefused) {
  for (const auto& [jpeg, coverage] :
       {std::pair{5U, 0U}, {3U, 0U}, {4U, 1U}, {0xFFFFFFFFU, 1U}, {1U, 0xFFFFFFFFU}, {0xFFFFFFFFU, 5U}, {0U, 4U}}) {
    const base::Bytes header = {0x46, 1, 1, 0};
    base::ByteWriter body;
    body.u32(jpeg);
    body.u32(coverage);
    body.u32(0x01020304);
    base::ByteWriter out;
    out.bytes(header);
    out.u32(base::crc32c(body.view(), base::crc32c(header)));
    out.bytes(body.view());
    const auto value = decodeFaceValue(out.view());
    ASSERT_FALSE(value) << jpeg << " " << coverage;
    EXPECT_EQ(value.error().message.find("checksum"), std::string::npos) << "the checksum was meant to hold";
  }
}

TEST(FaceValue, anotherVersionIsAVersionError) {
  base::Bytes bytes = encodeFaceValue({});
  bytes[1] = 2;
  const auto value = decodeFaceValue(bytes);
  ASSERT_FALSE(value);
  EXPECT_EQ(value.error().code, base::ErrorCode::kVersion);
}

// The bytes of version 1 must stay readable. The CRC-32C of 46 01 00 00 is 0x82C5942C, computed bit by bit elsewhere.
TEST(FaceValue, bytesOfVersionOneStay) {
  EXPECT_EQ(encodeFaceValue({}), (base::Bytes{0x46, 0x01, 0x00, 0x00, 0x2C, 0x94, 0xC5, 0x82}));
}

}  // namespace
}  // namespace repository
