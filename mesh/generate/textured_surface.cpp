#include "mesh/generate/textured_surface.h"

#include <algorithm>
#include <cmath>

namespace mesh::generate {
namespace {

// A count that is off by less than a hundredth is as good as any; above, it outweighs the shape of the quads.
double badness(const GridCounts& counts, std::uint64_t triangles, std::uint64_t wanted, const glm::dvec3& size) {
  const double off = std::abs(static_cast<double>(triangles) / static_cast<double>(wanted) - 1.0);
  const double width = size.x / counts.columns, height = size.y / counts.rows;
  const double aspect = std::max(width / height, height / width);
  return 100.0 * std::max(off, 0.01) + 0.2 * (aspect - 1.0);
}

}  // namespace

GridCounts chooseCounts(std::uint64_t wanted, const glm::dvec3& size, double area, const GridCounts& least,
                        const std::function<std::uint64_t(const GridCounts&)>& countTriangles) {
  const double edge = std::sqrt(2.0 * area / static_cast<double>(wanted));
  const auto about = [&](double length, double factor, std::uint32_t low) {
    return std::max(low, static_cast<std::uint32_t>(factor * length / edge));
  };
  GridCounts best;
  double least_bad = 1e300;
  const std::uint32_t first = about(size.x, 0.6, least.columns), last = about(size.x, 1.6, least.columns + 8);
  const std::uint32_t depth = about(size.z, 1.0, least.depth);
  for (std::uint32_t columns = first; columns <= last; columns += 1 + (last - first) / 64)
    for (const std::uint32_t layers : {depth, depth + (least.depth > 0 ? 1U : 0U)}) {
      // The count grows with the rows, by about as much for each.
      std::uint32_t low = least.rows, high = about(size.y, 3.0, least.rows + 8);
      while (low + 1 < high) {
        const std::uint32_t middle = low + (high - low) / 2;
        (countTriangles({columns, middle, layers}) <= wanted ? low : high) = middle;
      }
      for (const std::uint32_t rows : {low, low + 1}) {
        const GridCounts counts{columns, rows, layers};
        const double bad = badness(counts, countTriangles(counts), wanted, size);
        if (bad < least_bad) least_bad = bad, best = counts;
      }
    }
  return best;
}

std::vector<double> divided(const std::vector<double>& breaks, std::uint32_t count) {
  const std::size_t stretches = breaks.size() - 1;
  std::vector<std::uint32_t> counts(stretches, 1);
  const double length = breaks.back() - breaks.front();
  const double spare = static_cast<double>(count) - static_cast<double>(stretches);

  // Each stretch gets its share of the lines to spare, rounded so that the sum is right.
  double carried = 0.0;
  std::uint32_t given = 0;
  for (std::size_t k = 0; k < stretches; ++k) {
    carried += spare * (breaks[k + 1] - breaks[k]) / length;
    const auto due = static_cast<std::uint32_t>(carried + 0.5);
    counts[k] += due - given;
    given = due;
  }
  std::vector<double> lines{breaks.front()};
  for (std::size_t k = 0; k < stretches; ++k)
    for (std::uint32_t i = 1; i <= counts[k]; ++i)
      lines.push_back(i == counts[k] ? breaks[k + 1]
                                     : breaks[k] + (breaks[k + 1] - breaks[k]) * i / static_cast<double>(counts[k]));
  return lines;
}

double coverage(double distance, double texel) {
  return std::clamp(distance / texel + 0.5, 0.0, 1.0);
}

double coverage(const glm::dvec2& p, const glm::dvec2& low, const glm::dvec2& high, double texel) {
  const double half = 0.5 * texel;
  if (p.x < low.x - half || p.x > high.x + half || p.y < low.y - half || p.y > high.y + half) return 0.0;
  return coverage(std::min(p.x - low.x, high.x - p.x), texel) * coverage(std::min(p.y - low.y, high.y - p.y), texel);
}

double part(std::uint32_t hash, std::uint32_t shift) {
  return static_cast<double>((hash >> shift) & 255U) / 255.0;
}

glm::dvec3 blend(const glm::dvec3& a, const glm::dvec3& b, double share) {
  return a + (b - a) * share;
}

std::unique_ptr<SurfacePaint> makePaint(TexturedShape shape, std::uint64_t seed) {
  switch (shape) {
    case TexturedShape::kFacade:
      return makeFacadePaint(seed);
    case TexturedShape::kTerrain:
      return makeTerrainPaint(seed);
    case TexturedShape::kRooms:
      break;
  }
  return makeRoomsPaint(seed);
}

std::vector<Sign> signsOf(TexturedShape shape, std::uint64_t seed) {
  return makePaint(shape, seed)->signs();
}

}  // namespace mesh::generate
