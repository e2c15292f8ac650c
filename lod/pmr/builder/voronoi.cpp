#include "lod/pmr/builder/voronoi.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_cell_base_3.h>
#include <CGAL/Triangulation_data_structure_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace lod::pmr::builder {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using Data = CGAL::Triangulation_data_structure_3<Vertex, CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
using Delaunay = CGAL::Delaunay_triangulation_3<Kernel, Data>;

// How many times the points' extent the far points are away. Poles farther than this are not told apart.
constexpr double kFar = 16.0;

glm::dvec3 placeOf(const Delaunay::Vertex_handle& vertex) {
  const auto& p = vertex->point();
  return {p.x(), p.y(), p.z()};
}

// The centre of the sphere through the corners of a cell, relative to the first; not finite where they nearly lie in a
// plane.
glm::dvec3 circumcenter(const std::array<glm::dvec3, 4>& corners) {
  const glm::dvec3 a = corners[1] - corners[0], b = corners[2] - corners[0], c = corners[3] - corners[0];
  const double volume = 2.0 * glm::dot(a, glm::cross(b, c));
  return (glm::dot(a, a) * glm::cross(b, c) + glm::dot(b, b) * glm::cross(c, a) + glm::dot(c, c) * glm::cross(a, b)) /
         volume;
}

}  // namespace

std::vector<VoronoiCell> voronoiCells(std::span<const glm::dvec3> points) {
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> numbered;
  numbered.reserve(points.size() + 8);
  glm::dvec3 low(0.0), high(0.0);
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const glm::dvec3& p = points[i];
    low = i == 0 ? p : glm::min(low, p);
    high = i == 0 ? p : glm::max(high, p);
    numbered.emplace_back(Kernel::Point_3(p.x, p.y, p.z), i);
  }
  const glm::dvec3 middle = 0.5 * (low + high);
  const double far = kFar * std::max(glm::length(high - low), 1.0);
  for (std::uint32_t k = 0; k < 8; ++k)
    numbered.emplace_back(
        Kernel::Point_3(middle.x + ((k & 1) != 0 ? far : -far), middle.y + ((k & 2) != 0 ? far : -far),
                        middle.z + ((k & 4) != 0 ? far : -far)),
        static_cast<std::uint32_t>(points.size()) + k);
  const Delaunay delaunay(numbered.begin(), numbered.end());
  numbered = {};

  // The farthest vertex of each cell of the diagram, in a pass over all its vertices; then the farthest one on the
  // other side of the tangent plane. Nearly flat tetrahedra have their centre anywhere along their normal: where
  // rounding makes it no number, it is left out.
  struct Farthest {
    glm::dvec3 to{0.0};
    double squared = 0.0, opposite = 0.0;
  };
  std::vector<Farthest> farthest(points.size());
  const auto forEachVertex = [&](const auto& body) {
    for (auto cell = delaunay.finite_cells_begin(); cell != delaunay.finite_cells_end(); ++cell) {
      std::array<glm::dvec3, 4> corners;
      for (int k = 0; k < 4; ++k) corners[static_cast<std::size_t>(k)] = placeOf(cell->vertex(k));
      const glm::dvec3 from_first = circumcenter(corners);
      if (!std::isfinite(glm::dot(from_first, from_first))) continue;
      for (int k = 0; k < 4; ++k) {
        const std::uint32_t number = cell->vertex(k)->info();
        if (number < points.size())
          body(farthest[number], from_first + corners[0] - corners[static_cast<std::size_t>(k)]);
      }
    }
  };
  forEachVertex([](Farthest& f, const glm::dvec3& to) {
    const double squared = glm::dot(to, to);
    if (squared > f.squared) f.squared = squared, f.to = to;
  });
  forEachVertex([](Farthest& f, const glm::dvec3& to) {
    if (glm::dot(to, f.to) < 0.0) f.opposite = std::max(f.opposite, glm::dot(to, to));
  });

  std::vector<VoronoiCell> cells(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Farthest& f = farthest[i];
    if (f.squared > 0.0) cells[i].normal = f.to / std::sqrt(f.squared);
    cells[i].height = std::sqrt(f.opposite > 0.0 ? f.opposite : f.squared);
  }
  return cells;
}

}  // namespace lod::pmr::builder
