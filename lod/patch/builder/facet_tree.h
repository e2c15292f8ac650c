#pragma once
// A tree of boxes around the triangles of one group, for nearest searches. Triangles stay in their order: neighbours
// lie next to each other in stored patches, and sorting costs more than it saves.
#include <array>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

#include "base/geometry.h"
#include "base/simd.h"

namespace lod::patch::builder {

class FacetTree {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  bool isEmpty() const { return first_.empty(); }
  /// Forgets the triangles; memory is kept.
  void clear() { first_.clear(); }
  /// positions: whole numbers below 2^22. indices: 3 per triangle; one triangle or more, at most 4^16.
  void build(std::span<const glm::vec3> positions, std::span<const std::uint32_t> indices);

  /// The triangle t of the least measure(t), which is the squared distance of p from it, if that is below distance2
  /// (which is updated); else kNone. The search ends at any triangle within enough2.
  template <class Measure>
  std::uint32_t nearest(const glm::vec3& p, float& distance2, float enough2, Measure&& measure) const {
    struct Open {
      float distance2;
      std::uint32_t level;
      std::uint32_t node;
    };
    std::array<Open, kSiblings * kMaxLevels> open;
    std::size_t count = 0;
    open[count++] = {0.0F, static_cast<std::uint32_t>(first_.size()) - 1, 0};
    std::uint32_t best = kNone;
    while (count > 0 && (best == kNone || distance2 > enough2)) {
      const Open at = open[--count];
      if (!(at.distance2 < distance2)) continue;
      const Four far2 = boxes_[first_[at.level] + at.node].distance2(p);
      // Boxes are sorted so that the nearest lies last and is opened first.
      const std::size_t first = count;
      for (std::uint32_t k = 0; k < kSiblings; ++k) {
        if (!(far2[k] < distance2)) continue;
        std::size_t i = count++;
        for (; i > first && open[i - 1].distance2 < far2[k]; --i) open[i] = open[i - 1];
        open[i] = {far2[k], at.level - 1, kSiblings * at.node + k};
      }
      if (at.level > 0) continue;
      for (; count > first; --count) {
        const Open& triangle = open[count - 1];
        if (!(triangle.distance2 < distance2)) continue;
        if (const float d2 = measure(triangle.node); d2 < distance2) best = triangle.node, distance2 = d2;
      }
    }
    return best;
  }

 private:
  static constexpr std::uint32_t kSiblings = 4;
  static constexpr std::size_t kMaxLevels = 16;

  using Four = base::Float4;
  static constexpr float kNothing = -std::numeric_limits<float>::infinity();

  /// Four boxes side by side, by centres and half sizes, which are exact for whole positions. A half size of −∞ marks a
  /// box that is not there.
  struct Boxes {
    alignas(16) float center[3][kSiblings] = {};
    alignas(16) float half[3][kSiblings] = {{kNothing, kNothing, kNothing, kNothing},
                                            {kNothing, kNothing, kNothing, kNothing},
                                            {kNothing, kNothing, kNothing, kNothing}};

    Four distance2(const glm::vec3& p) const {
      const auto along = [&](std::size_t k, float at) {
        Four off;
        Four size;
        std::memcpy(&off, center[k], sizeof off);
        std::memcpy(&size, half[k], sizeof size);
        off -= at;
        const Four beyond = (off < 0.0F ? -off : off) - size;
        const Four outside = beyond > 0.0F ? beyond : Four{};
        return outside * outside;
      };
      return along(0, p.x) + along(1, p.y) + along(2, p.z);
    }
  };

  // Level 0 has a box for each triangle, in fours. Child k of node n of any other level is node 4 n + k of the level
  // below. The last level has one node.
  std::vector<Boxes> boxes_;
  std::vector<std::size_t> first_;  // per level: its first in boxes_
  std::vector<base::Aabb> below_;   // while the tree is built: the boxes of the level below
};

}  // namespace lod::patch::builder
