#pragma once
// Closed surfaces with known normals and medial axes, sampled at random.
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <numbers>
#include <random>
#include <vector>

namespace support {

struct ShapeSample {
  glm::dvec3 place{0.0}, normal{0.0};  ///< unit, outwards
  double height = 0.0;                 ///< distance of the medial axis within
};

/// A sphere around the origin.
inline std::vector<ShapeSample> sphereSamples(double radius, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<ShapeSample> samples;
  while (samples.size() < count) {
    const glm::dvec3 n = glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
    samples.push_back({radius * n, n, radius});
  }
  return samples;
}

/// A torus around the z axis; uniform by area. minor < major / 2.
inline std::vector<ShapeSample> torusSamples(double major, double minor, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> turn(0.0, 2.0 * std::numbers::pi), unit(0.0, 1.0);
  std::vector<ShapeSample> samples;
  while (samples.size() < count) {
    const double u = turn(random), v = turn(random);
    if (unit(random) * (major + minor) > major + minor * std::cos(v)) continue;
    const glm::dvec3 n(std::cos(v) * std::cos(u), std::cos(v) * std::sin(u), std::sin(v));
    samples.push_back({glm::dvec3(major * std::cos(u), major * std::sin(u), 0.0) + minor * n, n, minor});
  }
  return samples;
}

/// A box around the origin with these edges; uniform by area.
inline std::vector<ShapeSample> boxSamples(const glm::dvec3& edges, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-0.5, 0.5);
  std::discrete_distribution<int> face({edges.y * edges.z, edges.z * edges.x, edges.x * edges.y});
  std::vector<ShapeSample> samples;
  while (samples.size() < count) {
    const int axis = face(random), u = (axis + 1) % 3, v = (axis + 2) % 3;
    const double side = unit(random) < 0.0 ? -1.0 : 1.0;
    ShapeSample sample;
    sample.normal[axis] = side;
    sample.place[axis] = 0.5 * side * edges[axis];
    sample.place[u] = unit(random) * edges[u];
    sample.place[v] = unit(random) * edges[v];
    // The largest ball that touches the face here touches the nearest edge's other face, or the opposite one.
    const double to_edge =
        std::min(0.5 * edges[u] - std::abs(sample.place[u]), 0.5 * edges[v] - std::abs(sample.place[v]));
    sample.height = std::min(to_edge, 0.5 * edges[axis]);
    samples.push_back(sample);
  }
  return samples;
}

}  // namespace support
