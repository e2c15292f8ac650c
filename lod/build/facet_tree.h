#pragma once
// A tree of boxes around the triangles of one group, for nearest searches.
#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

namespace lod::build {

class FacetTree {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  /// positions: whole numbers, 0 … 2^21 − 1. indices: 3 per triangle.
  FacetTree(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices);

  /// The triangle t of least measure(t), the squared distance of p from it, if that is below distance2 (which is
  /// updated); else kNone. One at most enough2 is as good as any.
  template <class Measure>
  std::uint32_t nearest(const glm::vec3& p, float& distance2, float enough2, Measure&& measure) const {
    struct Open {
      std::uint32_t node;
      float distance2;
    };
    std::array<Open, 64> open;  // one sibling a level, and a tree has at most 32
    std::size_t count = 0;
    open[count++] = {1, boxes_[1].distance2(p)};
    std::uint32_t best = kNone;
    while (count > 0 && (best == kNone || distance2 > enough2)) {
      const Open at = open[--count];
      if (!(at.distance2 < distance2)) continue;
      if (at.node >= leaves_) {
        const std::size_t first = std::size_t{kLeaf} * (at.node - leaves_);
        for (std::size_t i = first; i < std::min(first + kLeaf, order_.size()); ++i)
          if (const float d2 = measure(order_[i]); d2 < distance2) best = order_[i], distance2 = d2;
        continue;
      }
      Open near{2 * at.node, boxes_[2 * at.node].distance2(p)};
      Open far{2 * at.node + 1, boxes_[2 * at.node + 1].distance2(p)};
      if (far.distance2 < near.distance2) std::swap(near, far);
      open[count++] = far;
      open[count++] = near;
    }
    return best;
  }

 private:
  static constexpr std::uint32_t kLeaf = 4;  // triangles

  struct Box {
    glm::vec3 low{std::numeric_limits<float>::infinity()};
    glm::vec3 high{-std::numeric_limits<float>::infinity()};
    float distance2(const glm::vec3& p) const {
      const glm::vec3 d = glm::max(glm::max(low - p, p - high), glm::vec3(0.0F));
      return glm::dot(d, d);
    }
  };

  std::vector<std::uint32_t> order_;  // triangles, along the Morton curve
  std::vector<Box> boxes_;            // of node n: its children are 2 n and 2 n + 1, the root is 1
  std::uint32_t leaves_ = 1;          // a power of two; leaf l is node leaves_ + l
};

}  // namespace lod::build
