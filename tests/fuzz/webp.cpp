// Feeds any bytes to decodeWebp, and as a frame's picture with a correct checksum to decodeFrameImage.
#include "repository/faces/webp.h"

#include "base/check.h"
#include "repository/faces/face_value.h"
#include "repository/faces/frame_image.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::int64_t kMaxPixels = 64 * 64;

base::Bytes seed(int width, int height, bool opaque) {
  base::Image image(width, height, 4);
  for (std::size_t i = 0; i < image.pixels.size(); ++i)
    image.pixels[i] = opaque && i % 4 == 3 ? 255 : static_cast<std::uint8_t>(i * i >> 5);
  return *repository::encodeWebp(image, 60);
}

void checkPixels(const base::Image& image) {
  LUMIGRID_CHECK(image.width >= 1 && image.height >= 1);
  LUMIGRID_CHECK(std::int64_t{image.width} * image.height <= kMaxPixels);
  LUMIGRID_CHECK_EQ(image.pixels.size(),
                    static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height) * 4);
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  return {seed(48, 32, false), seed(17, 9, true), seed(1, 1, false)};
}

void fuzzOne(base::ByteView bytes) {
  const auto image = repository::decodeWebp(bytes, kMaxPixels);
  if (image) checkPixels(*image);
  if (!repository::isWebp(bytes)) return;
  const auto frame = repository::decodeFrameImage(
      repository::encodeFaceValue({.empty = false, .picture = bytes, .coverage = {}}), kMaxPixels);
  LUMIGRID_CHECK(static_cast<bool>(frame) == static_cast<bool>(image));
}

}  // namespace fuzz
