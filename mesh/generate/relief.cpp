// Generates a carved stone panel of 4 × 3 units with a frame, a rosette, lines of glyphs and cracks. It is a height
// field with an open border.
#include <algorithm>
#include <cmath>

#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

constexpr double kWidth = 4.0;
constexpr double kHeight = 3.0;

double distanceToSegment(const glm::dvec2& p, const glm::dvec2& a, const glm::dvec2& b) {
  const glm::dvec2 ab = b - a;
  const double t = std::clamp(glm::dot(p - a, ab) / glm::dot(ab, ab), 0.0, 1.0);
  return glm::length(p - a - t * ab);
}

class Relief : public SampleSurface {
 public:
  Relief(std::uint64_t triangles, std::uint64_t seed)
      : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0x85EBCA77U) {
    const double quads = 0.5 * static_cast<double>(triangles);
    columns_ = std::max<std::uint64_t>(2, static_cast<std::uint64_t>(std::sqrt(quads * kWidth / kHeight) + 0.5));
    rows_ = std::max<std::uint64_t>(2, static_cast<std::uint64_t>(quads / static_cast<double>(columns_) + 0.5));
    weathering_ = std::make_unique<Weathering>(kWidth / static_cast<double>(columns_), seed_);
  }

  std::uint64_t rowCount() const override { return rows_ + 1; }
  std::uint64_t rowSize(std::uint64_t) const override { return columns_ + 1; }
  std::uint64_t triangleCount() const override { return 2 * rows_ * columns_; }

  SamplePoint point(std::uint64_t row, std::uint64_t column) const override {
    const double x = kWidth * static_cast<double>(column) / static_cast<double>(columns_);
    const double y = kHeight * (1.0 - static_cast<double>(row) / static_cast<double>(rows_));
    const glm::dvec3 flat(x, y, 0.0);
    double fine = 0.0;
    const double carved = carving({x, y}) + cracks(flat);
    const double height = 0.03 * carved + weathering_->roughness(flat, fine);
    return {{x, y, height}, weathering_->color(flat, std::clamp(0.7 * carved, -1.0, 1.0), fine)};
  }

  void band(std::uint64_t, std::uint32_t upper_start, std::uint32_t lower_start,
            std::vector<std::uint32_t>& corners) const override {
    for (std::uint32_t j = 0; j < columns_; ++j) {
      const std::uint32_t u = upper_start + j;
      const std::uint32_t l = lower_start + j;
      corners.insert(corners.end(), {u, l, l + 1, u, l + 1, u + 1});
    }
  }

 private:
  double carving(const glm::dvec2& p) const {
    // The frame is a raised border with a bead moulding along its inner rim.
    const double rim = std::min({p.x, kWidth - p.x, p.y, kHeight - p.y});
    const double frame = 2.2 * smooth(0.24, 0.18, rim);
    const double along = std::abs(p.x - 0.5 * kWidth) + std::abs(p.y - 0.5 * kHeight);
    const double beads = (0.5 + 0.5 * wave(9.0 * along)) * smooth(0.045, 0.02, std::abs(rim - 0.11));
    return frame + 0.8 * beads * smooth(0.2, 0.18, rim) + rosette(p) + glyphs(p);
  }

  // A sun disc is surrounded by rings, with rays between the outer ones.
  double rosette(const glm::dvec2& p) const {
    const glm::dvec2 d = p - glm::dvec2(1.35, 1.5);
    const double r = glm::length(d);
    if (r > 1.05) return 0.0;
    double h = 0.9 * smooth(0.26, 0.16, r) + 0.7 * wave(6.5 * r) * smooth(0.24, 0.30, r) * smooth(0.72, 0.66, r);

    // There are 24 rays. The angle, in turns, comes from the ratio of the sides, since libm is not used here.
    const double x = std::abs(d.x);
    const double y = std::abs(d.y);
    const double ratio = r > 0.0 ? std::min(x, y) / std::max(x, y) : 0.0;
    const double eighth = ratio * (0.1775 - 0.0525 * ratio);
    const double turn = x > y ? eighth : 0.25 - eighth;
    h += 0.8 * wave(24.0 * turn + 0.25) * smooth(0.72, 0.78, r) * smooth(1.0, 0.94, r);
    return h + 0.8 * smooth(0.03, 0.01, std::abs(r - 1.01));
  }

  // In lines of writing each cell holds four strokes between hashed points of a 3 × 4 lattice.
  double glyphs(const glm::dvec2& p) const {
    constexpr double kCell = 0.2;
    if (p.x < 2.56 || p.x > 3.7 || p.y < 0.4 || p.y > 2.6) return 0.0;
    const double x = (p.x - 2.56) / kCell;
    const double y = (p.y - 0.4) / (1.25 * kCell);
    const auto column = static_cast<std::int64_t>(x);
    const auto row = static_cast<std::int64_t>(y);
    const glm::dvec2 inside(x - static_cast<double>(column), y - static_cast<double>(row));
    double nearest = 1.0;
    for (std::int64_t stroke = 0; stroke < 4; ++stroke) {
      const std::uint32_t h = latticeHash(column, row, stroke, seed_ + 401U);
      const glm::dvec2 a(0.2 + 0.3 * (h % 3U), 0.15 + 0.23 * ((h >> 4U) % 4U));
      const glm::dvec2 b(0.2 + 0.3 * ((h >> 8U) % 3U), 0.15 + 0.23 * ((h >> 12U) % 4U));
      if (a != b) nearest = std::min(nearest, distanceToSegment(inside, a, b));
    }
    return -1.3 * smooth(0.09, 0.0, nearest);
  }

  // Cracks run where a warped noise crosses zero, in patches.
  double cracks(const glm::dvec3& p) const {
    const double where = smooth(0.05, 0.4, valueNoise(p * 0.9, seed_ + 409U));
    if (where <= 0.0) return 0.0;
    const glm::dvec3 warped = p + 0.08 * valueNoise(p * 9.0, seed_ + 419U);
    return -2.0 * where * smooth(0.05, 0.0, std::abs(valueNoise(warped * 1.9, seed_ + 421U)));
  }

  std::uint32_t seed_;
  std::uint64_t columns_ = 0;
  std::uint64_t rows_ = 0;
  std::unique_ptr<Weathering> weathering_;
};

}  // namespace

std::unique_ptr<SampleSurface> makeRelief(std::uint64_t triangles, std::uint64_t seed) {
  return std::make_unique<Relief>(triangles, seed);
}

}  // namespace mesh::generate
