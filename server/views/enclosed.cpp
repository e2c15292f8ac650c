#include "server/views/enclosed.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/geometry.h"
#include "base/parallel.h"
#include "lod/patch/traverse.h"

namespace server {
namespace {

constexpr double kInside = 0.9;   // 1 inside a closed surface, less where the coarse cut has holes; a choice
constexpr double kBehind = 0.25;  // a wide terrain has nearly ½ below it, −½ above it, and 0 beside it

// Signed solid angle of a triangle from the origin (Van Oosterom, Strackee 1983, equation 8).
double solidAngle(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  const double la = glm::length(a);
  const double lb = glm::length(b);
  const double lc = glm::length(c);
  const double numerator = glm::dot(a, glm::cross(b, c));
  const double denominator = la * lb * lc + glm::dot(a, b) * lc + glm::dot(b, c) * la + glm::dot(c, a) * lb;
  return 2.0 * std::atan2(numerator, denominator);
}

}  // namespace

base::Result<Enclosure> Enclosure::create(const lod::patch::PatchFile& patches, std::uint64_t max_triangles) {
  const lod::patch::Hierarchy& hierarchy = patches.hierarchy();
  const lod::patch::UniformCut finest = lod::patch::selectFinestUniformCut(hierarchy, max_triangles);
  Enclosure enclosure;
  enclosure.error_ = finest.error;
  for (const std::uint32_t patch : finest.cut.patches) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, patches.geometry(patch));
    const auto corner = [&](std::size_t i) {
      return hierarchy.lattice.position(geometry.positions[geometry.indices[i]]);
    };
    for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3)
      enclosure.triangles_.push_back({corner(i), corner(i + 1), corner(i + 2)});
  }
  return enclosure;
}

double Enclosure::windingNumber(const glm::vec3& point) const {
  const glm::dvec3 p(point);
  double sum = 0.0;
  for (const Triangle& t : triangles_) sum += solidAngle(glm::dvec3(t.a) - p, glm::dvec3(t.b) - p, glm::dvec3(t.c) - p);
  return sum / (4.0 * std::numbers::pi);
}

bool Enclosure::isBehind(const glm::vec3& point) const {
  return windingNumber(point) > kBehind;
}

bool Enclosure::encloses(const glm::vec3& point) const {
  if (windingNumber(point) <= kInside) return false;
  const double margin = static_cast<double>(error_) * static_cast<double>(error_);
  const glm::dvec3 p(point);
  return std::none_of(triangles_.begin(), triangles_.end(), [&](const Triangle& t) {
    const glm::dvec3 away = base::closestPointOnTriangle(p, glm::dvec3(t.a), glm::dvec3(t.b), glm::dvec3(t.c)) - p;
    return glm::dot(away, away) <= margin;
  });
}

std::vector<std::uint8_t> enclosedPoints(const Enclosure& enclosure, std::span<const glm::vec3> points,
                                         unsigned threads) {
  std::vector<std::uint8_t> enclosed(points.size(), 0);
  base::parallelFor(points.size(), threads,
                    [&](std::size_t i) { enclosed[i] = enclosure.encloses(points[i]) ? 1 : 0; });
  return enclosed;
}

}  // namespace server
