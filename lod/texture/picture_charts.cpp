#include "lod/texture/picture_charts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "lod/texture/coverage.h"

namespace lod::texture {
namespace {

// Triangles that are longer than so many pictures are not noted.
constexpr float kLongest = 4.0F;
constexpr std::uint64_t kEightTexels = 0x0101010101010101U;

}  // namespace

void PictureCharts::add(const PictureTriangle& triangle) {
  const glm::vec2 size(width_, height_);
  glm::vec2 low = triangle.corners[0], high = low;
  for (const glm::vec2& corner : triangle.corners) low = glm::min(low, corner), high = glm::max(high, corner);
  const bool finite = std::isfinite(low.x + low.y + high.x + high.y);
  if (!finite || glm::any(glm::greaterThan(high - low, kLongest * size))) return;

  // The parts in neighbouring repetitions are noted like the first.
  const glm::vec2 first = glm::floor(low / size), last = glm::floor(high / size);
  const MaskView mask{covered_.data(), width_, width_, height_};
  for (float y = first.y; y <= last.y; y += 1.0F)
    for (float x = first.x; x <= last.x; x += 1.0F) {
      std::array<glm::dvec2, 3> corners;
      for (std::size_t k = 0; k < 3; ++k) corners[k] = glm::dvec2(triangle.corners[k] - glm::vec2(x, y) * size);
      coverTriangle(corners, kReach, mask);
    }
}

bool PictureCharts::coversAll(const glm::ivec2& min, const glm::ivec2& size) const {
  // Many texels at a time; compilers make one instruction of a copy of 8 bytes.
  for (int y = min.y; y < min.y + size.y; ++y) {
    const std::uint8_t *texels = row(y) + min.x, *const end = texels + size.x;
    std::uint64_t all = kEightTexels;
    for (; end - texels >= 8; texels += 8) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, texels, sizeof(eight));
      all &= eight;
    }
    for (; texels != end; ++texels) all &= *texels == 0 ? 0 : kEightTexels;
    if (all != kEightTexels) return false;
  }
  return true;
}

void PictureCharts::growInto(base::Image& picture) {
  const auto width = static_cast<std::size_t>(width_);
  const auto channels = static_cast<std::size_t>(picture.channels);
  constexpr std::uint8_t kJustGrown = 2;
  for (int pass = 0; pass < kGrown; ++pass) {
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
        if (covered_[at] != 0) continue;
        std::array<std::uint32_t, 4> sum{};
        std::uint32_t count = 0;
        // The picture repeats: what lies beyond its edge is its other edge.
        for (const int j : {y == 0 ? height_ - 1 : y - 1, y, y + 1 == height_ ? 0 : y + 1})
          for (const int i : {x == 0 ? width_ - 1 : x - 1, x, x + 1 == width_ ? 0 : x + 1}) {
            if (covered_[static_cast<std::size_t>(j) * width + static_cast<std::size_t>(i)] != 1) continue;
            for (std::size_t k = 0; k < channels; ++k) sum[k] += picture.at(i, j)[k];
            ++count;
          }
        if (count == 0) continue;
        for (std::size_t k = 0; k < channels; ++k)
          picture.at(x, y)[k] = static_cast<std::uint8_t>((sum[k] + count / 2) / count);
        covered_[at] = kJustGrown;
      }
    std::replace(covered_.begin(), covered_.end(), kJustGrown, std::uint8_t{1});
  }
}

}  // namespace lod::texture
