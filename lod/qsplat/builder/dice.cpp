#include "lod/qsplat/builder/dice.h"

#include <algorithm>

namespace lod::qsplat::builder {
namespace {

double squaredLength(const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec3 d = b - a;
  return glm::dot(d, d);
}

// Cuts a triangle. midpoint(a, b, m) makes the corner between two, or returns false to stop; keep(corners) gets the
// triangles that are small enough. Returns false where it was stopped.
template <class Corner, class Midpoint, class Keep>
bool bisect(const std::array<Corner, 3>& t, double longest_squared, Midpoint& midpoint, Keep& keep) {
  const std::array<double, 3> edge{squaredLength(t[0].position, t[1].position),
                                   squaredLength(t[1].position, t[2].position),
                                   squaredLength(t[2].position, t[0].position)};
  const auto k = static_cast<std::size_t>(std::max_element(edge.begin(), edge.end()) - edge.begin());
  if (edge[k] <= longest_squared) {
    keep(t);
    return true;
  }
  const Corner &a = t[k], &b = t[(k + 1) % 3], &c = t[(k + 2) % 3];
  Corner m;
  return midpoint(a, b, m) && bisect<Corner>({a, m, c}, longest_squared, midpoint, keep) &&
         bisect<Corner>({m, b, c}, longest_squared, midpoint, keep);
}

}  // namespace

std::optional<std::uint64_t> countCuts(std::span<const glm::ivec3> points, double longest_edge,
                                       std::uint64_t max_cuts) {
  struct Point {
    glm::dvec3 position{0.0};
  };
  std::uint64_t cuts = 0;
  auto midpoint = [&](const Point& a, const Point& b, Point& m) {
    m.position = 0.5 * (a.position + b.position);
    return ++cuts <= max_cuts;
  };
  auto keep = [](const std::array<Point, 3>&) {};
  for (std::size_t i = 0; i < points.size(); i += 3)
    if (!bisect<Point>({Point{glm::dvec3(points[i])}, {glm::dvec3(points[i + 1])}, {glm::dvec3(points[i + 2])}},
                       longest_edge * longest_edge, midpoint, keep))
      return std::nullopt;
  return cuts;
}

Dicer::Dicer(std::span<const glm::ivec3> points, double longest_edge)
    : points_(points), longest_squared_(longest_edge * longest_edge) {}

void Dicer::cut(const std::array<std::uint32_t, 3>& corners, std::uint32_t triangle) {
  struct NumberedPoint {
    std::uint32_t number = 0;
    glm::dvec3 position{0.0};
  };
  auto midpoint = [&](const NumberedPoint& a, const NumberedPoint& b, NumberedPoint& m) {
    m.number = midpointOf(a.number, b.number);
    m.position = position(m.number);
    return true;
  };
  auto keep = [&](const std::array<NumberedPoint, 3>& t) {
    sub_triangles_.push_back({{t[0].number, t[1].number, t[2].number}, triangle});
  };
  std::array<NumberedPoint, 3> whole;
  for (std::size_t k = 0; k < 3; ++k) whole[k] = {corners[k], position(corners[k])};
  (void)bisect(whole, longest_squared_, midpoint, keep);
}

std::uint32_t Dicer::midpointOf(std::uint32_t a, std::uint32_t b) {
  const std::uint64_t edge = std::uint64_t{std::min(a, b)} << 32 | std::max(a, b);
  const auto [number, is_new] = by_edge_.insert(edge);
  if (is_new) midpoints_.push_back({a, b, 0.5 * (position(a) + position(b))});
  return static_cast<std::uint32_t>(points_.size()) + number;
}

}  // namespace lod::qsplat::builder
