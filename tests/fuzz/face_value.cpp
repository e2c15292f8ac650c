// Feeds any bytes to decodeFaceValue and decodeFaceImage, as they are and with a correct checksum.
#include "repository/faces/face_value.h"

#include <algorithm>

#include "base/check.h"
#include "base/crc32c.h"
#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_image.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kCrcOffset = 4;
constexpr std::size_t kHeaderBytes = 8;
constexpr int kSide = 16;

void decode(base::ByteView bytes) {
  const auto value = repository::decodeFaceValue(bytes);
  if (!value) return;
  const base::Bytes again = repository::encodeFaceValue(*value);
  LUMIGRID_CHECK(base::Bytes(bytes.begin(), bytes.end()) == again);
  const auto image = repository::decodeFaceImage(bytes, kSide);
  LUMIGRID_CHECK(!image || (value->empty ? image->empty() : image->width == kSide && image->height == kSide));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const base::Bytes jpeg(40, 0xD8);
  const base::Bytes coverage(9, 1);
  base::Image mask(kSide, kSide, 1);
  for (int y = 4; y < 12; ++y) std::fill_n(mask.at(y, y), 4, std::uint8_t{255});
  const base::Bytes real_jpeg = *base::encodeJpeg(base::Image(kSide, kSide, 3), 80, base::Subsampling::k420);
  const base::Bytes real_coverage = repository::encodeCoverage(mask);
  return {repository::encodeFaceValue({}), repository::encodeFaceValue({false, real_jpeg, real_coverage}),
          repository::encodeFaceValue({false, jpeg, coverage}), repository::encodeFaceValue({false, jpeg, {}})};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < kHeaderBytes) return;
  base::Bytes signed_bytes(bytes.begin(), bytes.end());
  const std::uint32_t crc = base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
  std::memcpy(signed_bytes.data() + kCrcOffset, &crc, sizeof(crc));
  decode(signed_bytes);
}

}  // namespace fuzz
