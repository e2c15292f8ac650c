#pragma once
// A triangle mesh that distances are measured to: facets with their planes and walls, edges, and fans of vertices.
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

#include "base/geometry.h"
#include "base/simd.h"

namespace lod::patch::builder {

/// The distance of 1 from the next float, in which bounds count roundings.
inline constexpr float kEpsilon = std::numeric_limits<float>::epsilon();

/// A tree of boxes around the triangles of one group, for nearest searches. Triangles stay in their order: neighbours
/// lie next to each other in stored patches, and sorting costs more than it saves.
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

struct SurfaceView {
  std::span<const glm::vec3> positions;     ///< whole numbers below 2^22
  std::span<const std::uint32_t> indices;   ///< 3 per triangle, of different vertices
  std::span<const glm::vec3> colors = {};   ///< per vertex, 0 … 255; or none
  std::span<const glm::vec3> normals = {};  ///< per vertex, of any length; or none
};

/// The share of ab at which the closest point to a + ap lies, in [0, 1].
inline float closestShare(const glm::vec3& ap, const glm::vec3& ab) {
  const float length2 = glm::dot(ab, ab);
  return length2 > 0.0F ? std::clamp(glm::dot(ap, ab) / length2, 0.0F, 1.0F) : 0.0F;
}

/// One triangle with its plane and its three walls. Wall k is the plane through the edge of corners k and k + 1,
/// upright on the triangle, positive inside, in units of length. Walls and plane lie lane by lane, so all four are
/// measured at once.
struct Facet {
  using Four = base::Float4;
  using FourMasks = base::Int4;
  struct FourPoints {
    Four x{};
    Four y{};
    Four z{};
    glm::vec3 operator[](std::size_t lane) const { return {x[lane], y[lane], z[lane]}; }
    Four dot(const FourPoints& p) const { return x * p.x + y * p.y + z * p.z; }
    Four dot(const glm::vec3& p) const { return x * p.x + y * p.y + z * p.z; }
  };

  FourPoints corners;      ///< lane 3: corner 0
  FourPoints planes;       ///< the walls; lane 3: the normal
  float longest = 0.0F;    ///< length of the longest edge
  float roughness = 0.0F;  ///< rounding error of heights over plane and walls, per length
  bool flat = false;       ///< the triangle has no area: plane and walls mean nothing
  bool thin = false;       ///< distances are measured to the edges alone

  glm::vec3 corner(std::size_t k) const { return corners[k]; }
  glm::vec3 wall(std::size_t k) const { return planes[k]; }
  glm::vec3 normal() const { return planes[3]; }

  /// The height of p over each wall, positive inside; lane 3: over the plane.
  Four inside(const glm::vec3& p) const { return planes.dot(toward(p)); }

  /// The walls whose lanes are set, as bits.
  static std::uint32_t wallsWhere(const FourMasks& mask) {
#if defined(__SSE__)
    return static_cast<std::uint32_t>(_mm_movemask_ps(std::bit_cast<__m128>(mask))) & 7U;
#else
    return static_cast<std::uint32_t>((mask[0] & 1) | (mask[1] & 2) | (mask[2] & 4));
#endif
  }

  /// The squared distance from p. Over the triangle that is the distance to its plane, else to the nearest of the edges
  /// that p lies beyond, since one of these holds the closest point.
  float distance2(const glm::vec3& p) const {
    const FourPoints to = toward(p);
    const Four in = planes.dot(to);
    if (!thin && wallsWhere(in >= 0.0F) == 7) return in[3] * in[3];
    const Four d2 = edgeDistances2(to);
    const Four far = Four{} + std::numeric_limits<float>::max();
    const Four counted = thin ? d2 : in >= 0.0F ? far : d2;
    return std::min({counted[0], counted[1], counted[2]});
  }

  /// Squared distances from p to the edges of corners k and k + 1.
  Four edgeDistances2(const glm::vec3& p) const {
    return edgeDistances2(toward(p));
  }

 private:
  FourPoints toward(const glm::vec3& p) const {
    return {p.x - corners.x, p.y - corners.y, p.z - corners.z};
  }
  static Four next(const Four& of) {
    return __builtin_shufflevector(of, of, 1, 2, 0, 0);
  }
  Four edgeDistances2(const FourPoints& to) const {
    const FourPoints edge{next(corners.x) - corners.x, next(corners.y) - corners.y, next(corners.z) - corners.z};
    const Four length2 = edge.dot(edge);
    const Four ratio = to.dot(edge) / length2;
    const Four raised = ratio < 0.0F ? Four{} : ratio;
    const Four one = Four{} + 1.0F;
    const Four share = length2 > 0.0F ? (one < raised ? one : raised) : Four{};
    const FourPoints d{to.x - share * edge.x, to.y - share * edge.y, to.z - share * edge.z};
    return d.dot(d);
  }
};

class FacetSurface {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  struct Edge {
    std::array<std::uint32_t, 2> vertex{kNone, kNone};
    std::array<std::uint32_t, 2> triangle{kNone, kNone};  ///< the first two of its triangles
    std::uint32_t triangles = 0;                          ///< 1: a border

    bool isInner() const { return triangles == 2; }
    std::uint32_t across(std::uint32_t t) const { return triangle[0] == t ? triangle[1] : triangle[0]; }
    bool endsAt(std::uint32_t v) const { return vertex[0] == v || vertex[1] == v; }
    std::uint32_t otherEnd(std::uint32_t v) const { return vertex[0] == v ? vertex[1] : vertex[0]; }
  };

  /// Forgets an earlier surface, but keeps its memory.
  void reset(const SurfaceView& surface);

  const SurfaceView& view() const { return surface_; }
  std::uint32_t triangleCount() const { return static_cast<std::uint32_t>(is_computed_.size()); }
  std::uint32_t corner(std::uint32_t t, std::size_t k) const { return surface_.indices[3 * std::size_t{t} + k]; }

  /// The place of vertex v among the corners of t, which has it.
  std::size_t cornerOf(std::uint32_t t, std::uint32_t v) const {
    return corner(t, 0) == v ? 0 : corner(t, 1) == v ? 1 : 2;
  }

  const Facet& facet(std::uint32_t t) {
    if (is_computed_[t] == 0) computeFacet(t, facets_[t]);
    return facets_[t];
  }

  /// A point of a triangle: corner 0 + share[0] · (corner 1 − corner 0) + share[1] · (corner 2 − corner 0).
  struct Spot {
    glm::vec2 share{0.0F};
    float distance = 0.0F;
  };
  /// The point of triangle t closest to p, up to rounding; it is no farther from p than its `distance`.
  Spot closest(std::uint32_t t, const glm::vec3& p) const;
  /// The interpolated colour there; only for a surface with colours.
  glm::vec3 colorAt(std::uint32_t t, const Spot& spot) const { return valueAt(surface_.colors, t, spot); }
  /// The interpolated normal there, of any length; only for a surface with normals.
  glm::vec3 normalAt(std::uint32_t t, const Spot& spot) const { return valueAt(surface_.normals, t, spot); }

  /// Each edge once: those of vertex 0, then the others of vertex 1, …; at a vertex in the order of triangles and
  /// corners.
  std::span<const Edge> edges() const { return {edges_.data(), edge_count_}; }
  /// The edge of corners k and k + 1.
  std::uint32_t edgeOf(std::uint32_t t, std::size_t k) const { return edge_of_[3 * std::size_t{t} + k]; }
  /// The edges of corners 0 and 1, 1 and 2, 2 and 0.
  std::span<const std::uint32_t, 3> edgesOf(std::uint32_t t) const {
    return std::span<const std::uint32_t, 3>(edge_of_.data() + 3 * std::size_t{t}, 3);
  }
  /// The edge of t at its corner v that is not e.
  std::uint32_t otherEdge(std::uint32_t t, std::uint32_t v, std::uint32_t e) const {
    const std::size_t k = cornerOf(t, v);
    const std::uint32_t one = edgeOf(t, k);
    return one != e ? one : edgeOf(t, k == 0 ? 2 : k - 1);
  }
  /// Some triangle beyond that edge, or kNone.
  std::uint32_t neighbor(std::uint32_t t, std::size_t k) const { return edges_[edgeOf(t, k)].across(t); }

  /// The triangles at vertex v, in rising order.
  std::span<const std::uint32_t> around(std::uint32_t v) const {
    return {around_.data() + fan_[v], fan_[v + 1] - fan_[v]};
  }
  /// A border edge that leads away from v in the winding of its triangle, and one that leads to it; kNone: v is not on
  /// a border.
  std::uint32_t leavingBorder(std::uint32_t v) const { return border_[v].leaving; }
  std::uint32_t arrivingBorder(std::uint32_t v) const { return border_[v].arriving; }
  /// The vertex where border edge e begins in that winding.
  std::uint32_t borderStart(std::uint32_t e) const;

  /// The facet around vertex v that is nearest to p, or one within enough2, if it is nearer than distance2 (which is
  /// updated); else `best`.
  std::uint32_t nearestAround(std::uint32_t v, const glm::vec3& p, float& distance2, std::uint32_t best,
                              float enough2 = 0.0F) {
    for (const std::uint32_t t : around(v)) {
      if (distance2 <= enough2) break;
      if (const float d2 = facet(t).distance2(p); d2 < distance2) best = t, distance2 = d2;
    }
    return best;
  }
  /// The first facet around vertex v that p lies over, no higher than `enough`, and the point under p; kNone: there is
  /// none. Thin facets do not count.
  std::uint32_t over(std::uint32_t v, const glm::vec3& p, float enough, Spot& spot);
  /// Goes from a facet to nearer ones around its corners until none is nearer, or one is within enough2.
  std::uint32_t descend(std::uint32_t t, const glm::vec3& p, float& distance2, float enough2);
  /// The facet nearest to p, or one within enough2, if it is nearer than distance2 (which is updated); else `best`.
  std::uint32_t search(const glm::vec3& p, float& distance2, std::uint32_t best, float enough2 = 0.0F);

 private:
  glm::vec3 valueAt(std::span<const glm::vec3> values, std::uint32_t t, const Spot& spot) const;
  void computeFacet(std::uint32_t t, Facet& f);
  void buildFans();
  void buildEdges();

  SurfaceView surface_;
  // Facets are computed when they are first asked for, since many never are.
  std::vector<Facet> facets_;
  std::vector<std::uint8_t> is_computed_;
  std::vector<std::uint32_t> fan_;
  std::vector<std::uint32_t> around_;
  std::vector<Edge> edges_;  // edge_count_ of them, and room for more
  std::uint32_t edge_count_ = 0;
  std::vector<std::uint32_t> edge_of_;
  struct Border {
    std::uint32_t leaving = kNone;
    std::uint32_t arriving = kNone;
  };
  std::vector<Border> border_;  // per vertex
  // These are used by reset() alone: the sides of triangles at each vertex that lead to a later vertex, and per vertex
  // the number, plus 1, of the edge that led to it last.
  struct Side {
    std::uint32_t end = 0;
    std::uint32_t triangle = 0;
    std::uint32_t number = 0;  // 3 * triangle + k
  };
  std::vector<std::uint32_t> next_;
  std::vector<std::uint32_t> first_side_;
  std::vector<std::uint32_t> next_side_;
  std::vector<Side> sides_;
  std::vector<std::uint32_t> seen_;
  FacetTree tree_;  // built by the first search()
};

}  // namespace lod::patch::builder
