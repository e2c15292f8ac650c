// Feeds any bytes to decodeCoverage. The first two bytes choose the size of the mask.
#include "repository/faces/coverage.h"

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr int kMaxSide = 96;

base::Bytes seed(int width, int height, int period) {
  base::Image mask(width, height, 1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) *mask.at(x, y) = (x * x + y * y) % period < period / 2 ? 255 : 0;
  }
  base::Bytes bytes = {static_cast<std::uint8_t>(width - 1), static_cast<std::uint8_t>(height - 1)};
  const base::Bytes coded = repository::encodeCoverage(mask);
  bytes.insert(bytes.end(), coded.begin(), coded.end());
  return bytes;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {seed(64, 64, 3000), seed(33, 71, 500), seed(16, 16, 7), seed(1, 1, 1), seed(8, 8, 2)};
}

void fuzzOne(base::ByteView bytes) {
  if (bytes.size() < 2) return;
  const int width = 1 + bytes[0] % kMaxSide;
  const int height = 1 + bytes[1] % kMaxSide;
  const auto mask = repository::decodeCoverage(bytes.subspan(2), width, height);
  if (!mask) return;
  LUMIGRID_CHECK_EQ(mask->pixels.size(), static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (const std::uint8_t pixel : mask->pixels) LUMIGRID_CHECK(pixel == 0 || pixel == 255);

  // An accepted mask must come back from its own encoding.
  const auto again = repository::decodeCoverage(repository::encodeCoverage(*mask), width, height);
  LUMIGRID_CHECK(again && again->pixels == mask->pixels);
}

}  // namespace fuzz
