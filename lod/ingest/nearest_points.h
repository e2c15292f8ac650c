#pragma once
// A k-d tree that finds the k nearest of a set of points, or those within a distance (Bentley 1975).
#include <algorithm>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/geometry.h"

namespace lod::ingest {

class NearestPoints {
 public:
  explicit NearestPoints(std::span<const glm::vec3> positions) : points_(positions.size()) {
    for (std::uint32_t i = 0; i < points_.size(); ++i) points_[i] = {positions[i], i};
    nodes_.reserve(2 * positions.size() / kBucket + 1);
    if (!points_.empty()) build(0, static_cast<std::uint32_t>(points_.size()));
  }

  struct Neighbour {
    float distance_squared = 0.0F;
    std::uint32_t index = 0;
    friend bool operator<(const Neighbour& a, const Neighbour& b) {
      return a.distance_squared != b.distance_squared ? a.distance_squared < b.distance_squared : a.index < b.index;
    }
  };
  /// Finds the `count` points nearest to `p` within the squared distance, nearest first; equally near ones by number.
  void find(const glm::vec3& p, std::size_t count, float reach_squared, std::vector<Neighbour>& found) const {
    found.clear();
    if (nodes_.empty() || count == 0) return;
    search(0, p, count, reach_squared, found);
  }

  /// Calls visit(index, squared distance) for the points within the squared distance, about nearest first. It returns
  /// the squared distance within which points still matter: at most what it was.
  template <class Visit>
  void visitWithin(const glm::vec3& p, float reach_squared, const Visit& visit) const {
    if (!nodes_.empty()) visitNode(0, p, reach_squared, visit);
  }

 private:
  static constexpr std::uint32_t kBucket = 8;  // points; the usual choice
  struct Point {
    glm::vec3 position{0.0F};
    std::uint32_t index = 0;
  };
  struct Node {
    std::uint32_t begin = 0, end = 0;
    std::uint32_t right = 0;  // number of the right child; 0 for a bucket of points. The left child follows its parent
    int axis = 0;
    float at = 0.0F;
  };

  void build(std::uint32_t begin, std::uint32_t end) {
    const auto number = static_cast<std::uint32_t>(nodes_.size());
    nodes_.push_back({begin, end, 0, 0, 0.0F});
    if (end - begin <= kBucket) return;
    base::Aabb box;
    for (std::uint32_t i = begin; i < end; ++i) box.add(points_[i].position);
    const glm::vec3 size = box.size();
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const std::uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(points_.begin() + begin, points_.begin() + middle, points_.begin() + end,
                     [axis](const Point& a, const Point& b) {
                       const float x = a.position[axis], y = b.position[axis];
                       return x != y ? x < y : a.index < b.index;
                     });
    nodes_[number].axis = axis;
    nodes_[number].at = points_[middle].position[axis];
    build(begin, middle);
    nodes_[number].right = static_cast<std::uint32_t>(nodes_.size());
    build(middle, end);
  }

  void search(std::uint32_t number, const glm::vec3& p, std::size_t count, float reach_squared,
              std::vector<Neighbour>& found) const {
    const Node& node = nodes_[number];
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const glm::vec3 d = points_[i].position - p;
        const Neighbour one{glm::dot(d, d), points_[i].index};
        if (one.distance_squared > reach_squared) continue;
        if (found.size() < count)
          found.push_back(one);
        else if (one < found.back())
          found.back() = one;
        else
          continue;
        for (std::size_t k = found.size() - 1; k > 0 && found[k] < found[k - 1]; --k) std::swap(found[k], found[k - 1]);
      }
      return;
    }
    const float beyond = p[node.axis] - node.at;
    search(beyond < 0.0F ? number + 1 : node.right, p, count, reach_squared, found);
    const float limit = found.size() < count ? reach_squared : found.back().distance_squared;
    if (beyond * beyond <= limit) search(beyond < 0.0F ? node.right : number + 1, p, count, reach_squared, found);
  }

  template <class Visit>
  void visitNode(std::uint32_t number, const glm::vec3& p, float& reach_squared, const Visit& visit) const {
    const Node& node = nodes_[number];
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const glm::vec3 d = points_[i].position - p;
        const float squared = glm::dot(d, d);
        if (squared <= reach_squared) reach_squared = visit(points_[i].index, squared);
      }
      return;
    }
    const float beyond = p[node.axis] - node.at;
    visitNode(beyond < 0.0F ? number + 1 : node.right, p, reach_squared, visit);
    if (beyond * beyond <= reach_squared) visitNode(beyond < 0.0F ? node.right : number + 1, p, reach_squared, visit);
  }

  std::vector<Point> points_;  // in the order of the nodes
  std::vector<Node> nodes_;
};

}  // namespace lod::ingest
