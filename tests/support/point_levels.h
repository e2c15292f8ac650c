#pragma once
// The levels of a cloud that is one block, and surfaces of umbrellas over any part of its points.
#include <algorithm>
#include <cstdint>
#include <glm/glm.hpp>
#include <numeric>
#include <random>
#include <vector>

#include "lod/pmr/builder/decimate.h"
#include "lod/pmr/builder/surroundings.h"
#include "lod/pmr/builder/umbrellas.h"
#include "tests/support/surface_distance.h"

namespace support {

struct PointLevels {
  static constexpr double kReach = 1e9;  ///< the builder's is half the edge of a cell
  std::vector<glm::dvec3> places;        ///< steps of a lattice, as the builder has them
  std::vector<lod::pmr::builder::VoronoiCell> cells;
  std::vector<glm::dvec3> normals;
  std::vector<float> limits;  ///< of heights
  std::vector<std::uint8_t> classes;
  std::vector<bool> at_rim;

  /// `most`: what heights count at most, as the edge of a leaf bounds it; the default bounds nothing.
  explicit PointLevels(std::vector<glm::dvec3> points, float most = 1e9F) : places(std::move(points)) {
    using namespace lod::pmr::builder;
    cells = voronoiCells(places);
    // As the builder does: points of a regular grid lie on no common circle.
    std::mt19937 random(99);
    std::uniform_real_distribution<double> at(0.0, 1e-3);
    for (glm::dvec3& p : places) p += glm::dvec3(at(random), at(random), at(random));
    const Neighbourhoods near(places);
    limits = heightLimits(places, near, std::vector<std::uint32_t>(places.size()), std::vector(places.size(), most));
    const PointBlock block{places, places.size(), limits};
    mendRims(block, near, cells);
    normals = umbrellaNormals(block, near, cells, places.size());
    classes = decimate(block, near, cells);
    std::vector<std::uint32_t> all(places.size());
    std::iota(all.begin(), all.end(), 0U);
    Umbrellas umbrellas(places, all);
    Umbrella umbrella;
    for (const std::uint32_t i : all) {
      umbrellas.find(i, glm::vec3(normals[i]), 0.0, umbrella);
      at_rim.push_back(!umbrella.isClosed());
    }
  }

  std::vector<std::uint32_t> at(std::uint32_t level) const {
    std::vector<std::uint32_t> left;
    for (std::uint32_t i = 0; i < classes.size(); ++i)
      if (classes[i] >= level) left.push_back(i);
    return left;
  }
  /// The umbrellas of these points, sorted, each once.
  std::vector<lod::pmr::builder::Triangle> umbrellasOf(const std::vector<std::uint32_t>& left) const {
    using namespace lod::pmr::builder;
    std::vector<glm::dvec3> of_level;
    for (const std::uint32_t i : left) of_level.push_back(places[i]);
    Umbrellas umbrellas(of_level, left);
    std::vector<Triangle> triangles;
    Umbrella umbrella;
    for (std::uint32_t k = 0; k < left.size(); ++k) {
      const double reach = at_rim[left[k]] || left.size() == places.size() ? 0.0 : kReach;
      umbrellas.find(k, glm::vec3(normals[left[k]]), reach, umbrella);
      umbrella.appendTriangles(left[k], triangles);
    }
    std::sort(triangles.begin(), triangles.end());
    triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
    return triangles;
  }
  Surface surfaceOf(const std::vector<std::uint32_t>& left) const {
    Surface surface;
    surface.positions.assign(places.begin(), places.end());
    for (const auto& triangle : umbrellasOf(left))
      for (const std::uint32_t i : triangle.corners()) surface.indices.push_back(i);
    return surface;
  }
};

}  // namespace support
