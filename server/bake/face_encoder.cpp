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

}  // namespace

base::Image coverageMask(const base::Image& rgba) {
  base::Image mask(rgba.width, rgba.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i)
    mask.pixels[i] = rgba.pixels[4 * i + 3] >= kCoverageThreshold ? 255 : 0;
  return mask;
}

bool showsModel(const base::Image& rgba) {
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4)
    if (rgba.pixels[i] >= kCoverageThreshold) return true;
  return false;
}

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
  EncodedFace face;
  face.empty = !showsModel(rgba);
  if (face.empty) {
    face.value = repository::encodeFaceValue({});
    return face;
  }

  const base::Image mask = coverageMask(rgba);
  auto jpeg = repository::encodeJpeg(fillBackground(rgba, mask), quality, subsampling);
  if (!jpeg) return jpeg.error();
  const base::Bytes coverage = repository::encodeCoverage(mask);
  face.jpeg_bytes = jpeg->size();
  face.coverage_bytes = coverage.size();
  face.value = repository::encodeFaceValue({false, *jpeg, coverage});
  return face;
}

}  // namespace server
