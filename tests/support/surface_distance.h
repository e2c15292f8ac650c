#pragma once
// Measures distances between surfaces by sampling, independent of the builder's own bounds, which tests check by them.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <numeric>
#include <random>
#include <vector>

#include "base/geometry.h"

namespace support {

/// Holds plain triangles: positions and 3 indices each.
struct Surface {
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> indices;

  std::size_t triangles() const { return indices.size() / 3; }
  const glm::vec3& corner(std::size_t t, std::size_t k) const { return positions[indices[3 * t + k]]; }
};

/// Computes the nearest distance to a surface by a tree of boxes.
class NearestSurface {
 public:
  explicit NearestSurface(const Surface& surface) : surface_(surface), order_(surface.triangles()) {
    std::iota(order_.begin(), order_.end(), 0U);
    if (!order_.empty()) build(0, order_.size());
  }

  double distance(const glm::vec3& p) const {
    if (order_.empty()) return std::numeric_limits<double>::infinity();
    double best2 = std::numeric_limits<double>::infinity();
    visit(0, glm::dvec3(p), best2);
    return std::sqrt(best2);
  }

 private:
  struct Node {
    base::Aabb box;
    std::size_t begin = 0;
    std::size_t end = 0;
    std::size_t right = 0;  // 0: a leaf; the left child is the next node
  };

  std::size_t build(std::size_t begin, std::size_t end) {
    const std::size_t number = nodes_.size();
    nodes_.push_back({{}, begin, end, 0});
    base::Aabb box;
    for (std::size_t i = begin; i < end; ++i)
      for (std::size_t k = 0; k < 3; ++k) box.add(surface_.corner(order_[i], k));
    nodes_[number].box = box;
    if (end - begin <= 4) return number;
    const glm::vec3 size = box.size();
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    auto middle_of = [&](std::uint32_t t) {
      return surface_.corner(t, 0)[axis] + surface_.corner(t, 1)[axis] + surface_.corner(t, 2)[axis];
    };
    const std::size_t middle = (begin + end) / 2;
    std::nth_element(order_.begin() + static_cast<std::ptrdiff_t>(begin),
                     order_.begin() + static_cast<std::ptrdiff_t>(middle),
                     order_.begin() + static_cast<std::ptrdiff_t>(end),
                     [&](std::uint32_t a, std::uint32_t b) { return middle_of(a) < middle_of(b); });
    build(begin, middle);
    nodes_[number].right = build(middle, end);
    return number;
  }

  static double distance2(const base::Aabb& box, const glm::dvec3& p) {
    const glm::dvec3 d = glm::max(glm::max(glm::dvec3(box.min) - p, p - glm::dvec3(box.max)), glm::dvec3(0.0));
    return glm::dot(d, d);
  }

  void visit(std::size_t number, const glm::dvec3& p, double& best2) const {
    const Node& node = nodes_[number];
    if (distance2(node.box, p) >= best2) return;
    if (node.right == 0) {
      for (std::size_t i = node.begin; i < node.end; ++i) {
        const std::uint32_t t = order_[i];
        const glm::dvec3 d =
            p - base::closestPointOnTriangle(p, glm::dvec3(surface_.corner(t, 0)), glm::dvec3(surface_.corner(t, 1)),
                                             glm::dvec3(surface_.corner(t, 2)));
        best2 = std::min(best2, glm::dot(d, d));
      }
      return;
    }
    const bool left_first = distance2(nodes_[number + 1].box, p) <= distance2(nodes_[node.right].box, p);
    visit(left_first ? number + 1 : node.right, p, best2);
    visit(left_first ? node.right : number + 1, p, best2);
  }

  const Surface& surface_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

struct SampledDistance {
  double mean = 0.0;  ///< over points spread evenly by area
  double rms = 0.0;   ///< their root mean square
  double p95 = 0.0;   ///< their 95th percentile
  double p999 = 0.0;  ///< their 99.9th percentile
  double max = 0.0;   ///< over those and all vertices in use
};

/// Draws random points of a surface, by area.
class SurfacePoints {
 public:
  SurfacePoints(const Surface& surface, std::uint32_t seed) : surface_(surface), random_(seed) {
    for (std::size_t t = 0; t < surface.triangles(); ++t) {
      const glm::dvec3 a(surface.corner(t, 0));
      sum_ += 0.5 * glm::length(glm::cross(glm::dvec3(surface.corner(t, 1)) - a, glm::dvec3(surface.corner(t, 2)) - a));
      area_sum_.push_back(sum_);
    }
  }
  glm::dvec3 next() {
    const auto found = std::lower_bound(area_sum_.begin(), area_sum_.end(), unit_(random_) * sum_);
    const auto t = static_cast<std::size_t>(std::min(found, area_sum_.end() - 1) - area_sum_.begin());
    const double r = std::sqrt(unit_(random_));
    const double s = unit_(random_);
    return (1.0 - r) * glm::dvec3(surface_.corner(t, 0)) + r * (1.0 - s) * glm::dvec3(surface_.corner(t, 1)) +
           r * s * glm::dvec3(surface_.corner(t, 2));
  }

 private:
  const Surface& surface_;
  std::vector<double> area_sum_;
  double sum_ = 0.0;
  std::mt19937 random_;
  std::uniform_real_distribution<double> unit_{0.0, 1.0};
};

/// Distances to `to` from `samples` random points of `from` (by area, fixed seed) and from as many of its vertices.
inline SampledDistance sampledDistance(const Surface& from, const NearestSurface& to, std::size_t samples) {
  SampledDistance result;
  SurfacePoints points(from, 7);
  std::vector<double> distances(samples);
  for (std::size_t i = 0; i < samples; ++i) {
    const double d = to.distance(glm::vec3(points.next()));
    result.mean += d / static_cast<double>(samples);
    result.rms += d * d / static_cast<double>(samples);
    result.max = std::max(result.max, d);
    distances[i] = d;
  }
  result.rms = std::sqrt(result.rms);
  for (const auto& [percentile, mille] : {std::pair(&result.p95, 950), std::pair(&result.p999, 999)}) {
    if (samples == 0) break;
    const auto place = distances.begin() + static_cast<std::ptrdiff_t>((samples - 1) * mille / 1000);
    std::nth_element(distances.begin(), place, distances.end());
    *percentile = *place;
  }
  const std::size_t stride = std::max<std::size_t>(1, from.indices.size() / std::max<std::size_t>(1, samples));
  for (std::size_t i = 0; i < from.indices.size(); i += stride)
    result.max = std::max(result.max, to.distance(from.positions[from.indices[i]]));
  return result;
}

}  // namespace support
