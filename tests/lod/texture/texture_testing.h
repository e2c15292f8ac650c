#pragma once
// Pictures, triangles in them, and a second way to look a texture up: in software, as a GPU does.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "lod/texture/page.h"

namespace texture_testing {

using lod::texture::kCornerSteps;
using lod::texture::Page;
using lod::texture::PageTriangle;
using lod::texture::PictureTriangle;

inline base::Image noise(int width, int height, int channels = 3, unsigned seed = 1) {
  base::Image image(width, height, channels);
  std::mt19937 random(seed);
  for (std::uint8_t& value : image.pixels) value = static_cast<std::uint8_t>(random());
  return image;
}
/// A picture that JPEG keeps well.
inline base::Image smooth(int width, int height, int channels = 3) {
  base::Image image(width, height, channels);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < channels; ++c)
        image.at(x, y)[c] = static_cast<std::uint8_t>(128.0 + 100.0 * std::sin(0.03 * (c + 1) * x + 0.05 * y));
  return image;
}
inline void paint(base::Image& image, const glm::ivec2& min, const glm::ivec2& max, std::vector<std::uint8_t> color) {
  for (int y = min.y; y < max.y; ++y)
    for (int x = min.x; x < max.x; ++x) std::copy(color.begin(), color.end(), image.at(x, y));
}

/// Adds a rectangle as cells × cells squares of two triangles.
inline void addGrid(std::vector<PictureTriangle>& triangles, const glm::vec2& min, const glm::vec2& max, int cells) {
  const auto corner = [&](int i, int j) {
    return min + (max - min) * glm::vec2(static_cast<float>(i), static_cast<float>(j)) / static_cast<float>(cells);
  };
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const auto number = static_cast<std::uint16_t>(triangles.size());
      triangles.push_back({number, {corner(i, j), corner(i + 1, j), corner(i, j + 1)}});
      triangles.push_back(
          {static_cast<std::uint16_t>(number + 1), {corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)}});
    }
  }
}
inline std::vector<PictureTriangle> grid(const glm::vec2& min, const glm::vec2& max, int cells) {
  std::vector<PictureTriangle> triangles;
  addGrid(triangles, min, max, cells);
  return triangles;
}

/// The mip levels of an image, each the mean of 2 × 2 texels of the one before, without rounding.
struct Level {
  int width = 0, height = 0, channels = 0;
  std::vector<float> texels;
};
inline std::vector<Level> mipLevels(const base::Image& image, std::uint32_t count) {
  std::vector<Level> levels(1);
  levels[0] = {image.width, image.height, image.channels, {image.pixels.begin(), image.pixels.end()}};
  while (levels.size() < count) {
    const Level& fine = levels.back();
    Level coarse{std::max(1, fine.width / 2), std::max(1, fine.height / 2), fine.channels, {}};
    for (int y = 0; y < coarse.height; ++y) {
      for (int x = 0; x < coarse.width; ++x) {
        for (int c = 0; c < fine.channels; ++c) {
          const auto at = [&](int i, int j) {
            const int column = std::min(2 * x + i, fine.width - 1), row = std::min(2 * y + j, fine.height - 1);
            return fine.texels[static_cast<std::size_t>((row * fine.width + column) * fine.channels + c)];
          };
          coarse.texels.push_back((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0F);
        }
      }
    }
    levels.push_back(std::move(coarse));
  }
  return levels;
}

/// A bilinear look-up; `at` in texels of level 0.
inline float lookUp(const Level& level, const glm::dvec2& at, int level_number, int channel, bool repeats = false) {
  const glm::dvec2 p = at / std::pow(2.0, level_number) - 0.5;
  const glm::dvec2 cell = glm::floor(p), share = p - cell;
  const auto texel = [&](double x, double y) {
    const auto placed = [&](double value, int size) {
      const double rest = repeats ? value - size * std::floor(value / size) : std::clamp(value, 0.0, size - 1.0);
      return static_cast<int>(rest);
    };
    const int column = placed(x, level.width), row = placed(y, level.height);
    return double{level.texels[static_cast<std::size_t>((row * level.width + column) * level.channels + channel)]};
  };
  const double upper = glm::mix(texel(cell.x, cell.y), texel(cell.x + 1, cell.y), share.x);
  const double lower = glm::mix(texel(cell.x, cell.y + 1), texel(cell.x + 1, cell.y + 1), share.x);
  return static_cast<float>(glm::mix(upper, lower, share.y));
}

/// Points of a triangle: its corners, the middles of its edges, and some drawn at random.
inline std::vector<glm::dvec3> pointsOfTriangle(std::mt19937& random) {
  std::vector<glm::dvec3> points{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {.5, .5, 0}, {0, .5, .5}, {.5, 0, .5}};
  std::uniform_real_distribution<double> share(0.0, 1.0);
  for (int i = 0; i < 8; ++i) {
    const double a = share(random), b = share(random);
    points.push_back(a + b < 1.0 ? glm::dvec3(a, b, 1.0 - a - b) : glm::dvec3(1.0 - a, 1.0 - b, a + b - 1.0));
  }
  return points;
}
inline glm::dvec2 pointOf(const std::array<glm::dvec2, 3>& corners, const glm::dvec3& shares) {
  return corners[0] * shares.x + corners[1] * shares.y + corners[2] * shares.z;
}
/// In texels.
inline std::array<glm::dvec2, 3> cornersOf(const PageTriangle& triangle) {
  std::array<glm::dvec2, 3> corners;
  for (int i = 0; i < 3; ++i) corners[i] = glm::dvec2(triangle.corners[i]) / double{kCornerSteps};
  return corners;
}
inline std::array<glm::dvec2, 3> cornersOf(const PictureTriangle& triangle) {
  std::array<glm::dvec2, 3> corners;
  for (int i = 0; i < 3; ++i)  // rounded as makePages() rounds them
    corners[i] = glm::floor(glm::dvec2(triangle.corners[i]) * double{kCornerSteps} + 0.5) / double{kCornerSteps};
  return corners;
}

/// The largest difference between look-ups in the pages and in the picture, over points of all triangles.
inline float lookUpDifference(const std::vector<Page>& pages, const base::Image& picture,
                              const std::vector<PictureTriangle>& triangles) {
  std::mt19937 random(7);
  const Level source = mipLevels(picture, 1)[0];
  float largest = 0.0F;
  for (const Page& page : pages) {
    const Level level = mipLevels(page.image, 1)[0];
    for (const PageTriangle& placed : page.triangles) {
      const auto given = std::find_if(triangles.begin(), triangles.end(),
                                      [&](const PictureTriangle& t) { return t.triangle == placed.triangle; });
      for (const glm::dvec3& shares : pointsOfTriangle(random))
        for (int c = 0; c < page.image.channels; ++c)
          largest = std::max(largest, std::abs(lookUp(level, pointOf(cornersOf(placed), shares), 0, c) -
                                               lookUp(source, pointOf(cornersOf(*given), shares), 0, c, true)));
    }
  }
  return largest;
}

inline std::vector<std::uint16_t> numbersOf(const std::vector<Page>& pages) {
  std::vector<std::uint16_t> numbers;
  for (const Page& page : pages)
    for (const PageTriangle& triangle : page.triangles) numbers.push_back(triangle.triangle);
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}
inline double areaOf(const std::vector<Page>& pages) {
  double area = 0.0;
  for (const Page& page : pages) area += double(page.image.width) * page.image.height;
  return area;
}

}  // namespace texture_testing
