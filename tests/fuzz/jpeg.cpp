// Feeds any bytes to decodeJpeg.
#include "base/jpeg/jpeg.h"

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr int kMaxSide = 128;

base::Bytes seed(int width, int height, base::Subsampling subsampling) {
  base::Image image(width, height, 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = static_cast<std::uint8_t>(i * i >> 5);
  return *base::encodeJpeg(image, 60, subsampling);
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {seed(48, 32, base::Subsampling::k420), seed(17, 9, base::Subsampling::k422),
          seed(8, 8, base::Subsampling::k444)};
}

void fuzzOne(base::ByteView bytes) {
  const auto image = base::decodeJpeg(bytes, kMaxSide);
  if (!image) return;
  LUMIGRID_CHECK(image->width >= 1 && image->width <= kMaxSide && image->height >= 1 && image->height <= kMaxSide);
  LUMIGRID_CHECK_EQ(image->pixels.size(),
                    static_cast<std::size_t>(image->width) * static_cast<std::size_t>(image->height) * 3);
}

}  // namespace fuzz
