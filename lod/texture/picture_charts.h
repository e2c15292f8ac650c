#pragma once
// A source picture as it lies under all triangles that use it: the charts, and the gaps between them.
#include <glm/glm.hpp>

#include <cstdint>
#include <vector>

#include "base/image.h"
#include "lod/texture/page.h"

namespace lod::texture {

/// Which texels of a picture some triangle covers.
class PictureCharts {
 public:
  PictureCharts(int width, int height) : width_(width), height_(height), covered_(std::size_t(width) * height) {}
  /// Notes the texels whose centres lie on the triangle or just beside it. Where it reaches beyond the picture, which
  /// repeats, it is noted where it starts. Safe from several threads.
  void add(const PictureTriangle& triangle);
  /// Gives the texels of gaps that are up to kGrown texels from a chart the mean colour of the chart's beside them.
  /// Pictures are looked up between four texels, so those at a chart's edge show half of what lies beyond it, which
  /// scanning programs often leave black.
  void growInto(base::Image& picture);
  static constexpr int kGrown = 2;
  /// Texels whose centres lie so far outside a triangle still count, since corners are rounded.
  static constexpr double kReach = 0.25;
  /// Whether a texel of the picture is covered.
  bool covers(int x, int y) const { return row(y)[x] != 0; }
  /// Whether all of a rectangle of the picture is.
  bool coversAll(const glm::ivec2& min, const glm::ivec2& size) const;

 private:
  const std::uint8_t* row(int y) const { return &covered_[static_cast<std::size_t>(y) * std::size_t(width_)]; }

  int width_, height_;
  std::vector<std::uint8_t> covered_;
};

}  // namespace lod::texture
