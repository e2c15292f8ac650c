#pragma once
// The tangent polygon of a point: where the plane through it that is perpendicular to its normal cuts its Voronoi cell
// (Dey and Hudson 2002, section 2, figure 2).
//
// The cell is what the bisecting planes of the point and each other one leave, so the polygon can be cut from the plane
// by the bisectors of points nearby, without a Voronoi diagram in space: a point farther than twice the polygon's
// radius cuts nothing. A corner lies at equal distance from the point and those whose bisectors meet there, and no
// point is nearer. So it is on the Voronoi edge that is dual to their Delaunay triangle: one of the umbrella.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

namespace lod::pmr::builder {

class TangentPolygon {
 public:
  static constexpr std::uint32_t kMaxCorners = 32;
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};

  /// Begins with a square of this half edge around `center`, whose edges belong to no point.
  TangentPolygon(const glm::dvec3& center, const glm::dvec3& unit_normal, double half_edge) : center_(center) {
    const glm::dvec3 side = std::abs(unit_normal.x) < 0.8 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
    u_ = glm::normalize(glm::cross(unit_normal, side));
    v_ = glm::cross(unit_normal, u_);
    corners_[0] = {{-half_edge, -half_edge}, kNone};
    corners_[1] = {{half_edge, -half_edge}, kNone};
    corners_[2] = {{half_edge, half_edge}, kNone};
    corners_[3] = {{-half_edge, half_edge}, kNone};
    count_ = 4;
    measure();
  }

  /// Cuts off what is nearer to the point `number` at `place`. Points that are straight above the centre cut nothing.
  void cut(const glm::dvec3& place, std::uint32_t number) {
    const glm::dvec3 d = place - center_;
    const double squared = glm::dot(d, d);
    if (squared >= 4.0 * radius_squared_) return;
    const glm::dvec2 across(glm::dot(d, u_), glm::dot(d, v_));
    const double half = 0.5 * squared;
    std::array<double, kMaxCorners> beyond;
    bool cuts = false;
    for (std::uint32_t i = 0; i < count_; ++i) {
      beyond[i] = glm::dot(corners_[i].at, across) - half;
      cuts |= beyond[i] > 0.0;
    }
    if (!cuts) return;
    std::array<Corner, kMaxCorners + 1> left;
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < count_; ++i) {
      const std::uint32_t next = i + 1 == count_ ? 0 : i + 1;
      const double x = beyond[i], y = beyond[next];
      const auto crossing = [&] { return corners_[i].at + (corners_[next].at - corners_[i].at) * (x / (x - y)); };
      if (x <= 0.0) {
        left[kept++] = corners_[i];
        if (y > 0.0) left[kept++] = {crossing(), number};
      } else if (y <= 0.0) {
        left[kept++] = {crossing(), corners_[i].edge};
      }
      if (kept > kMaxCorners - 1) return;  // so many cocircular points: those before make a fine umbrella
    }
    if (kept < 3) return;  // a point at the very place of the centre
    std::copy_n(left.begin(), kept, corners_.begin());
    count_ = kept;
    measure();
  }

  /// The distance of the farthest corner.
  double radius() const { return std::sqrt(radius_squared_); }
  double radiusSquared() const { return radius_squared_; }
  std::uint32_t corners() const { return count_; }
  /// The point whose bisector is the edge that begins at corner i, in the order around the centre; kNone for what is
  /// left of the square.
  std::uint32_t edge(std::uint32_t i) const { return corners_[i].edge; }
  /// The point of the edge that ends at corner i.
  std::uint32_t edgeBefore(std::uint32_t i) const { return corners_[i == 0 ? count_ - 1 : i - 1].edge; }

 private:
  struct Corner {
    glm::dvec2 at{0.0};
    std::uint32_t edge = kNone;  // of the edge from here to the next corner
  };

  void measure() {
    radius_squared_ = 0.0;
    for (std::uint32_t i = 0; i < count_; ++i)
      radius_squared_ = std::max(radius_squared_, glm::dot(corners_[i].at, corners_[i].at));
  }

  glm::dvec3 center_, u_{0.0}, v_{0.0};
  std::array<Corner, kMaxCorners> corners_;
  std::uint32_t count_ = 0;
  double radius_squared_ = 0.0;
};

}  // namespace lod::pmr::builder
