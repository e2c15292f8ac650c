#include "server/bake/face_encoder.h"

#include <algorithm>
#include <glm/glm.hpp>
#include <utility>
#include <vector>

#include "base/check.h"
#include "repository/coverage.h"
#include "repository/face_value.h"

namespace server {
namespace {

constexpr int kBlock = 8;  // a JPEG's DCT block

// Mean colours of the blocks that hold model, later of all.
struct Blocks {
  int columns;
  int rows;
  std::vector<glm::ivec3> color;
  std::vector<std::uint8_t> known;

  explicit Blocks(const base::Image& image)
      : columns((image.width + kBlock - 1) / kBlock),
        rows((image.height + kBlock - 1) / kBlock),
        color(count()),
        known(count(), 0) {}
  std::size_t count() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(column);
  }
};

template <class Visit>
void forPixels(const base::Image& image, int column, int row, const Visit& visit) {
  const int x1 = std::min(image.width, (column + 1) * kBlock);
  const int y1 = std::min(image.height, (row + 1) * kBlock);
  for (int y = row * kBlock; y < y1; ++y) {
    for (int x = column * kBlock; x < x1; ++x) visit(x, y);
  }
}

Blocks modelMeans(const base::Image& rgba, const base::Image& mask) {
  Blocks blocks(rgba);
  for (int row = 0; row < blocks.rows; ++row) {
    for (int column = 0; column < blocks.columns; ++column) {
      glm::ivec3 sum(0);
      int count = 0;
      forPixels(rgba, column, row, [&](int x, int y) {
        if (*mask.at(x, y) == 0) return;
        const std::uint8_t* pixel = rgba.at(x, y);
        sum += glm::ivec3(pixel[0], pixel[1], pixel[2]);
        ++count;
      });
      if (count == 0) continue;
      blocks.color[blocks.index(column, row)] = (sum + glm::ivec3(count / 2)) / count;
      blocks.known[blocks.index(column, row)] = 1;
    }
  }
  return blocks;
}

// Gives every block without model the mean of its known neighbours, ring by ring from the model outward. Integers, in a
// fixed order: the same on every machine.
void spreadOutward(Blocks& blocks) {
  std::vector<std::pair<std::size_t, glm::ivec3>> ring;
  do {
    ring.clear();
    for (int row = 0; row < blocks.rows; ++row) {
      for (int column = 0; column < blocks.columns; ++column) {
        if (blocks.known[blocks.index(column, row)] != 0) continue;
        glm::ivec3 sum(0);
        int count = 0;
        for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
          const int x = column + dx;
          const int y = row + dy;
          if (x < 0 || y < 0 || x >= blocks.columns || y >= blocks.rows || blocks.known[blocks.index(x, y)] == 0)
            continue;
          sum += blocks.color[blocks.index(x, y)];
          ++count;
        }
        if (count > 0) ring.emplace_back(blocks.index(column, row), (sum + glm::ivec3(count / 2)) / count);
      }
    }
    for (const auto& [index, color] : ring) blocks.color[index] = color, blocks.known[index] = 1;
  } while (!ring.empty());
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
  Blocks blocks = modelMeans(rgba, mask);
  spreadOutward(blocks);
  base::Image rgb(rgba.width, rgba.height, 3);
  for (int row = 0; row < blocks.rows; ++row) {
    for (int column = 0; column < blocks.columns; ++column) {
      const glm::ivec3 filler = blocks.color[blocks.index(column, row)];
      forPixels(rgba, column, row, [&](int x, int y) {
        const bool model = *mask.at(x, y) != 0;
        for (int c = 0; c < 3; ++c) rgb.at(x, y)[c] = model ? rgba.at(x, y)[c] : static_cast<std::uint8_t>(filler[c]);
      });
    }
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

}  // namespace server
