#include "server/bake/face_encoder.h"

#include <algorithm>
#include <glm/glm.hpp>
#include <vector>

#include "base/check.h"
#include "repository/coverage.h"
#include "repository/face_value.h"

namespace server {
namespace {

// One level of a pyramid of colours; a level's pixel stands for 2 × 2 of the level below.
struct Level {
  int width;
  int height;
  std::vector<glm::ivec3> color;
  std::vector<std::uint8_t> known;

  Level(int w, int h)
      : width(w), height(h), color(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)), known(color.size(), 0) {}
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
  }
};

Level modelPixels(const base::Image& rgba, const base::Image& mask) {
  Level level(rgba.width, rgba.height);
  for (std::size_t i = 0; i < level.color.size(); ++i) {
    const std::uint8_t* pixel = &rgba.pixels[4 * i];
    level.color[i] = glm::ivec3(pixel[0], pixel[1], pixel[2]);
    level.known[i] = mask.pixels[i] != 0 ? 1 : 0;
  }
  return level;
}

// Means of the known ones among 2 × 2, in integers: the same on every machine.
Level halved(const Level& fine) {
  Level coarse((fine.width + 1) / 2, (fine.height + 1) / 2);
  for (int y = 0; y < coarse.height; ++y) {
    for (int x = 0; x < coarse.width; ++x) {
      glm::ivec3 sum(0);
      int count = 0;
      for (int v = 2 * y; v < std::min(fine.height, 2 * y + 2); ++v) {
        for (int u = 2 * x; u < std::min(fine.width, 2 * x + 2); ++u) {
          if (fine.known[fine.index(u, v)] == 0) continue;
          sum += fine.color[fine.index(u, v)];
          ++count;
        }
      }
      if (count == 0) continue;
      coarse.color[coarse.index(x, y)] = (sum + glm::ivec3(count / 2)) / count;
      coarse.known[coarse.index(x, y)] = 1;
    }
  }
  return coarse;
}

void fillFrom(const Level& coarse, Level& fine) {
  for (int y = 0; y < fine.height; ++y) {
    for (int x = 0; x < fine.width; ++x) {
      if (fine.known[fine.index(x, y)] == 0) fine.color[fine.index(x, y)] = coarse.color[coarse.index(x / 2, y / 2)];
    }
  }
}

base::Image maskOf(const base::Image& rgba) {
  base::Image mask(rgba.width, rgba.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i)
    mask.pixels[i] = rgba.pixels[4 * i + 3] >= kCoverageThreshold ? 255 : 0;
  return mask;
}

}  // namespace

base::Image fillBackground(const base::Image& rgba, const base::Image& mask) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  std::vector<Level> pyramid = {modelPixels(rgba, mask)};
  while (pyramid.back().width > 1 || pyramid.back().height > 1) pyramid.push_back(halved(pyramid.back()));
  for (std::size_t level = pyramid.size() - 1; level > 0; --level) fillFrom(pyramid[level], pyramid[level - 1]);

  base::Image rgb(rgba.width, rgba.height, 3);
  for (std::size_t i = 0; i < pyramid[0].color.size(); ++i) {
    for (int c = 0; c < 3; ++c)
      rgb.pixels[3 * i + static_cast<std::size_t>(c)] = static_cast<std::uint8_t>(pyramid[0].color[i][c]);
  }
  return rgb;
}

base::Result<EncodedFace> encodeFace(const base::Image& rgba, int quality, repository::Subsampling subsampling) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  const base::Image mask = maskOf(rgba);
  EncodedFace face;
  face.empty = std::find(mask.pixels.begin(), mask.pixels.end(), std::uint8_t{255}) == mask.pixels.end();
  if (face.empty) {
    face.value = repository::encodeFaceValue({});
    return face;
  }

  auto jpeg = repository::encodeJpeg(fillBackground(rgba, mask), quality, subsampling);
  if (!jpeg) return jpeg.error();
  const base::Bytes coverage = repository::encodeCoverage(mask);
  face.jpeg_bytes = jpeg->size();
  face.coverage_bytes = coverage.size();
  face.value = repository::encodeFaceValue({false, *jpeg, coverage});
  return face;
}

base::Result<base::Image> decodeFace(base::ByteView value, int face_size) {
  const auto face = repository::decodeFaceValue(value);
  if (!face) return face.error();
  if (face->empty) return base::Image();
  const auto rgb = repository::decodeJpeg(face->jpeg, face_size);
  if (!rgb) return rgb.error();
  if (rgb->width != face_size || rgb->height != face_size)
    return base::Error{base::ErrorCode::kInvalidInput, "a face of " + std::to_string(rgb->width) + " x " +
                                                           std::to_string(rgb->height) + " pixels, not " +
                                                           std::to_string(face_size)};
  base::Image mask;
  if (!face->coverage.empty()) {
    auto decoded = repository::decodeCoverage(face->coverage, face_size, face_size);
    if (!decoded) return decoded.error();
    mask = std::move(*decoded);
  }
  base::Image rgba(face_size, face_size, 4);
  for (std::size_t i = 0; 4 * i < rgba.pixels.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) rgba.pixels[4 * i + c] = rgb->pixels[3 * i + c];
    rgba.pixels[4 * i + 3] = mask.empty() ? 255 : mask.pixels[i];
  }
  return rgba;
}

}  // namespace server
