#pragma once
// Points in the cells of a grid, of which each cell keeps one (Guthe et al. 2004, section 3.2).
#include <algorithm>
#include <cstdint>
#include <glm/glm.hpp>
#include <unordered_map>
#include <vector>

#include "lod/hlod/builder/node_mesh.h"

namespace lod::hlod::builder {

/// A point of a cluster lies in the middle of the box of those that it stands for, at most half of a cell's diagonal
/// from each, and has the mean of their attributes. Those that face different ways stay apart, so that both sides of a
/// thin wall remain.
class PointClusters {
 public:
  /// `cell`: the edge of the grid's cells, in the units of the positions.
  explicit PointClusters(float cell) : cell_(cell) {}

  /// `error`: how far the point is from what it stands for.
  void add(const MeshPoint& point, float error) {
    const auto [found, is_new] = numbers_.try_emplace(keyOf(point), clusters_.size());
    if (is_new) clusters_.push_back({point.position, point.position, point.normal});
    Cluster& cluster = clusters_[found->second];
    cluster.low = glm::min(cluster.low, point.position), cluster.high = glm::max(cluster.high, point.position);
    cluster.normal += glm::dvec3(point.normal), cluster.color += glm::dvec3(point.color);
    ++cluster.count;
    cluster.error = std::max(cluster.error, error);
  }

  std::vector<MeshPoint> points() const {
    std::vector<MeshPoint> points;
    points.reserve(clusters_.size());
    for (const Cluster& c : clusters_) {
      const double length = glm::length(c.normal);
      points.push_back({0.5F * (c.low + c.high), length > 0.0 ? glm::vec3(c.normal / length) : c.first_normal,
                        glm::vec3(c.color / static_cast<double>(c.count))});
    }
    return points;
  }
  /// The largest distance of a point from what it stands for.
  float error() const {
    float largest = 0.0F;
    for (const Cluster& c : clusters_) largest = std::max(largest, c.error + 0.5F * glm::distance(c.low, c.high));
    return largest;
  }

 private:
  struct Cluster {
    glm::vec3 low{0.0F}, high{0.0F}, first_normal{0.0F, 0.0F, 1.0F};
    glm::dvec3 normal{0.0}, color{0.0};
    std::uint32_t count = 0;
    float error = 0.0F;
  };

  std::uint64_t keyOf(const MeshPoint& point) const {
    const glm::ivec3 cell = glm::ivec3(glm::floor(point.position / cell_));
    const glm::vec3 size = glm::abs(point.normal);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const auto side = static_cast<std::uint64_t>(2 * axis + (point.normal[axis] < 0.0F ? 1 : 0));
    const auto part = [](int x) { return static_cast<std::uint64_t>(x) & 0xfffff; };
    return part(cell.x) | part(cell.y) << 20 | part(cell.z) << 40 | side << 60;
  }

  const float cell_;
  std::unordered_map<std::uint64_t, std::size_t> numbers_;
  std::vector<Cluster> clusters_;
};

/// The points that stand for a small triangle: its corners and the middles of its edges (figure 3).
template <class Visit>
void visitSamples(const NodeMesh& mesh, std::size_t triangle, const Visit& visit) {
  const auto place = [&](std::size_t k) {
    const std::uint32_t v = mesh.indices[3 * triangle + k % 3];
    return MeshPoint{mesh.positions[v], mesh.normals[v], mesh.colors.empty() ? glm::vec3(255.0F) : mesh.colors[v]};
  };
  for (std::size_t k = 0; k < 3; ++k) {
    const MeshPoint a = place(k), b = place(k + 1);
    visit(a);
    const glm::vec3 normal = a.normal + b.normal;
    const float length = glm::length(normal);
    visit({0.5F * (a.position + b.position), length > 0.0F ? normal / length : a.normal, 0.5F * (a.color + b.color)});
  }
}

}  // namespace lod::hlod::builder
