#pragma once
// Ways to thin points that look at no features, to compare decimation with; and surfaces to thin.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <numbers>
#include <numeric>
#include <random>
#include <tuple>
#include <vector>

#include "tests/support/surface_distance.h"

namespace support {

/// So many of the points, by chance; by rising number.
inline std::vector<std::uint32_t> randomThinning(std::size_t points, std::size_t count, std::uint32_t seed) {
  std::vector<std::uint32_t> order(points);
  std::iota(order.begin(), order.end(), 0U);
  std::shuffle(order.begin(), order.end(), std::mt19937(seed));
  order.resize(std::min(count, points));
  std::sort(order.begin(), order.end());
  return order;
}

/// The points left by throwing darts: in a random order each stays that has none within `distance` (Cook 1986).
inline std::vector<std::uint32_t> thinnedTo(const std::vector<glm::dvec3>& places, double distance,
                                            std::uint32_t seed) {
  const auto cellOf = [distance](const glm::dvec3& p) { return glm::ivec3(glm::floor(p / distance)); };
  std::map<std::tuple<int, int, int>, std::vector<std::uint32_t>> grid;
  std::vector<std::uint32_t> left;
  std::vector<std::uint32_t> order(places.size());
  std::iota(order.begin(), order.end(), 0U);
  std::shuffle(order.begin(), order.end(), std::mt19937(seed));
  for (const std::uint32_t i : order) {
    const glm::ivec3 c = cellOf(places[i]);
    bool near = false;
    for (int k = 0; k < 27 && !near; ++k) {
      const auto found = grid.find({c.x + k % 3 - 1, c.y + k / 3 % 3 - 1, c.z + k / 9 - 1});
      if (found == grid.end()) continue;
      near = std::any_of(found->second.begin(), found->second.end(),
                         [&](std::uint32_t j) { return glm::distance(places[i], places[j]) < distance; });
    }
    if (near) continue;
    grid[{c.x, c.y, c.z}].push_back(i);
    left.push_back(i);
  }
  std::sort(left.begin(), left.end());
  return left;
}

/// About so many of the points, evenly spread: the distance of thinnedTo() is found by halving.
inline std::vector<std::uint32_t> uniformThinning(const std::vector<glm::dvec3>& places, std::size_t count,
                                                  std::uint32_t seed) {
  glm::dvec3 low(places.front()), high(low);
  for (const glm::dvec3& p : places) low = glm::min(low, p), high = glm::max(high, p);
  double small = 0.0, large = glm::length(high - low);
  std::vector<std::uint32_t> best;
  for (int step = 0; step < 24; ++step) {
    const double distance = 0.5 * (small + large);
    best = thinnedTo(places, distance, seed);
    if (best.size() > count + count / 200)
      small = distance;
    else if (best.size() + count / 200 < count)
      large = distance;
    else
      break;
  }
  return best;
}

/// A surface of revolution of the circle of radius `minor` around the circle of radius `major`, which may be 0.
inline void addRing(Surface& surface, const glm::dvec3& at, double major, double minor, std::uint32_t around,
                    std::uint32_t across) {
  const auto first = static_cast<std::uint32_t>(surface.positions.size());
  // A sphere is half a circle turned.
  const double arc = (major > 0.0 ? 2.0 : 1.0) * std::numbers::pi;
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t k = 0; k <= across; ++k) {
      const double u = 2.0 * std::numbers::pi * i / around, v = arc * k / across - 0.5 * std::numbers::pi;
      const double r = major + minor * std::cos(v);
      surface.positions.emplace_back(at + glm::dvec3(r * std::cos(u), r * std::sin(u), minor * std::sin(v)));
    }
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t k = 0; k < across; ++k) {
      const std::uint32_t a = first + i * (across + 1) + k, b = first + (i + 1) % around * (across + 1) + k;
      surface.indices.insert(surface.indices.end(), {a, b, b + 1, a, b + 1, a + 1});
    }
}

/// A closed box.
inline void addBox(Surface& surface, const glm::dvec3& low, const glm::dvec3& high) {
  const auto first = static_cast<std::uint32_t>(surface.positions.size());
  for (int k = 0; k < 8; ++k)
    surface.positions.emplace_back((k & 1) != 0 ? high.x : low.x, (k & 2) != 0 ? high.y : low.y,
                                   (k & 4) != 0 ? high.z : low.z);
  for (const std::uint32_t i :
       {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4, 2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5})
    surface.indices.push_back(first + i);
}

inline std::vector<glm::dvec3> pointsOn(const Surface& surface, std::size_t count, std::uint32_t seed) {
  SurfacePoints random(surface, seed);
  std::vector<glm::dvec3> points;
  while (points.size() < count) points.push_back(random.next());
  return points;
}

}  // namespace support
