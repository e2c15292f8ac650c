#pragma once
// Plans the collapses of edges: which end stays, where, and at what cost. Two or four edges are planned at once.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/simd.h"
#include "lod/patch/builder/quadric.h"

// Vectors of four doubles are passed only to functions that become part of their caller: no ABI says how.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"

namespace lod::patch::builder {

enum class VertexKind : std::uint8_t { kInterior, kBorder, kLocked };

/// Which end of edge (a, b) a collapse keeps, by the kinds of its ends. A border edge has other than two triangles.
enum class KeptEnd : std::uint8_t { kNone, kA, kB, kBest };
inline constexpr KeptEnd kKeepOnInnerEdge[3][3] = {
    // b: interior      border       locked
    {KeptEnd::kBest, KeptEnd::kB, KeptEnd::kB},     // a: interior
    {KeptEnd::kA, KeptEnd::kNone, KeptEnd::kNone},  // a: border
    {KeptEnd::kA, KeptEnd::kNone, KeptEnd::kNone},  // a: locked
};
inline constexpr KeptEnd kKeepOnBorderEdge[3][3] = {
    {KeptEnd::kBest, KeptEnd::kB, KeptEnd::kB},
    {KeptEnd::kA, KeptEnd::kBest, KeptEnd::kB},
    {KeptEnd::kA, KeptEnd::kA, KeptEnd::kNone},
};

/// An edge and the collapse that is planned for it. The plan is of the time when `planned` collapses had been done.
struct PlannedEdge {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  std::uint32_t planned : 31 = 0;
  std::uint32_t keeps_a : 1 = 0;  // else b
  float cost = 0.0F;
  glm::vec3 position{0.0F};
  float along = 0.0F;  // 0 at the kept end, 1 at the gone one: where attributes are taken
};

/// All that a plan reads of a vertex, in two cache lines, since plans take the vertices in random order.
struct alignas(64) QuadricVertex {
  Quadric quadric;
  glm::vec3 position{0.0F};
  glm::vec3 normal{0.0F};
  glm::vec3 color{0.0F};  // zero when the mesh has none
  float paid = 0.0F;      // the quadric at the vertex's place: an error that is already there

  // Always inlined: gcc drops calls of a function that only prefetches, as if it did nothing.
  __attribute__((always_inline)) void prefetch() const {
    __builtin_prefetch(&quadric);
    __builtin_prefetch(&normal);
  }
};
static_assert(sizeof(QuadricVertex) == 128);

/// The nearest lattice coordinate, halves rounded up; so is what misses a half by less than the rounding of such linear
/// systems. A double near kNoFractions has no bits for fractions, so adding and subtracting that number rounds, halves
/// to even; the comparison corrects the halves.
template <class Lanes>
LUMIGRID_ALWAYS_INLINE Lanes rounded(const Lanes& value) {
  constexpr double kAbove = 1 << 24;  // no coordinate is larger; sums with it keep 28 bits of fraction
  constexpr double kNoFractions = 3.0 * (1LL << 51);
  const Lanes raised = value + (kAbove + 0.5);
  const Lanes near = (raised + kNoFractions) - kNoFractions;
  return (near > raised ? near - 1.0 : near) - kAbove;
}

class EdgePlanner {
 public:
  /// All three must live as long as the planner. `collapses`: how many have been done, which plans note.
  EdgePlanner(const std::vector<QuadricVertex>& vertices, const std::vector<VertexKind>& kinds,
              const std::uint32_t& collapses)
      : vertices_(vertices), kinds_(kinds), collapses_(collapses) {}

  /// Costs are scaled by these: the area of the fans that do not count as small, and the lengths that a change of
  /// normal by 60 degrees and of colour by 1/255 stand for.
  void setScales(double small_fans, double normal_scale, double color_scale) {
    small_fans_ = small_fans;
    normal_scale_ = normal_scale;
    color_scale_ = color_scale;
  }

  /// Which end of an edge a collapse keeps, by the kinds of its ends.
  static KeptEnd keptEndOf(VertexKind a, VertexKind b, bool border_edge) {
    const auto row = static_cast<std::size_t>(a);
    const auto column = static_cast<std::size_t>(b);
    return border_edge ? kKeepOnBorderEdge[row][column] : kKeepOnInnerEdge[row][column];
  }

  /// Plans edge(0) … edge(count - 1).
  template <class EdgeAt>
  void planAll(std::size_t count, EdgeAt&& edge) const {
    std::size_t i = 0;
#if defined(__x86_64__)
    static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
    for (; has_avx2 && i + 4 <= count; i += 4) planFour(edge(i), edge(i + 1), edge(i + 2), edge(i + 3));
#endif
    for (; i < count; i += 2) planTwo(edge(i), edge(std::min(i + 1, count - 1)));
  }
  /// Plans two edges, or one twice.
  void planTwo(PlannedEdge& first, PlannedEdge& second) const {
    planLanes<base::Double2>({&first, &second});
  }

 private:
#if defined(__x86_64__)
  __attribute__((target("avx2"))) void planFour(PlannedEdge& first, PlannedEdge& second, PlannedEdge& third,
                                                PlannedEdge& fourth) const {
    planLanes<base::Double4>({&first, &second, &third, &fourth});
  }
#endif

  // Plans which end stays, where, and at what cost. A plan does not look at the edge's triangles, so the kinds decide
  // as on a border edge. No branch could predict which choice is the better one, so none is a branch.
  template <class Lanes>
  LUMIGRID_ALWAYS_INLINE void planLanes(const std::array<PlannedEdge*, kLaneCount<Lanes>>& edges) const {
    constexpr std::size_t kLanes = kLaneCount<Lanes>;
    MaskOf<Lanes> free{};
    std::array<const QuadricVertex*, kLanes> kept_end;
    std::array<const QuadricVertex*, kLanes> gone_end;
    for (std::size_t i = 0; i < kLanes; ++i) {
      PlannedEdge& edge = *edges[i];
      const KeptEnd keep = keptEndOf(kinds_[edge.a], kinds_[edge.b], true);
      edge.keeps_a = keep == KeptEnd::kA ? 1 : 0;
      free[i] = keep == KeptEnd::kBest ? -1 : 0;
      kept_end[i] = &vertices_[keep == KeptEnd::kA ? edge.a : edge.b];
      gone_end[i] = &vertices_[keep == KeptEnd::kA ? edge.b : edge.a];
    }
    const auto place_of = [](const auto& ends) __attribute__((always_inline)) {
      return PointLanes<Lanes>{lanesOf<Lanes>([&](std::size_t i) { return ends[i]->position.x; }),
                               lanesOf<Lanes>([&](std::size_t i) { return ends[i]->position.y; }),
                               lanesOf<Lanes>([&](std::size_t i) { return ends[i]->position.z; })};
    };
    const QuadricLanes<Lanes> q([&](std::size_t i) -> const Quadric& { return kept_end[i]->quadric; },
                                [&](std::size_t i) -> const Quadric& { return gone_end[i]->quadric; });
    const PointLanes<Lanes> kept = place_of(kept_end);
    const PointLanes<Lanes> gone = place_of(gone_end);
    const Lanes at_kept = q.at(kept);
    const Lanes at_gone = q.at(gone);

    // The kept end moves to the lattice point nearest to the point of least error, or to the edge's middle where the
    // planes determine none.
    const PointLanes<Lanes> middle{0.5 * (kept.x + gone.x), 0.5 * (kept.y + gone.y), 0.5 * (kept.z + gone.z)};
    const PointLanes<Lanes> span = gone - kept;
    const Lanes length2 = dot(span, span);
    PointLanes<Lanes> best;
    const MaskOf<Lanes> determined = q.minimum(best);
    const PointLanes<Lanes> reach = best - middle;
    const MaskOf<Lanes> solved = determined & (dot(reach, reach) <= kMaxPlacementReach * kMaxPlacementReach * length2);
    best = either<Lanes>(solved, best, middle);
    const Lanes along = dot(best - kept, span) / length2;
    const PointLanes<Lanes> lattice{rounded(best.x), rounded(best.y), rounded(best.z)};
    const Lanes at_best = q.at(lattice);

    // The cheapest of these three places, or the kept end's where that must not move. The cost is what the collapse
    // adds to the errors that both ends have already: that lowers the sum of all errors greedily, and vertices that
    // have an error do not keep good collapses beside them waiting.
    const Lanes one = Lanes{} + 1.0;
    const MaskOf<Lanes> takes_best = free & (at_best < at_kept) & (at_best < at_gone);
    const MaskOf<Lanes> takes_gone = free & (at_gone < at_kept);
    const Lanes error = takes_best ? at_best : takes_gone ? at_gone : at_kept;
    const PointLanes<Lanes> place = either<Lanes>(takes_best, lattice, either<Lanes>(takes_gone, gone, kept));
    const Lanes share = along > one ? one : along > 0.0 ? along : Lanes{};
    const Lanes taken_at = takes_best ? share : takes_gone ? one : Lanes{};
    const Lanes paid = lanesOf<Lanes>([&](std::size_t i) { return kept_end[i]->paid; }) +
                       lanesOf<Lanes>([&](std::size_t i) { return gone_end[i]->paid; });
    const Lanes added = error > paid ? error - paid : Lanes{};

    // Colours and normals that differ make an edge dearer, in proportion to the smaller of the areas that would change.
    const Lanes kept_weight = lanesOf<Lanes>([&](std::size_t i) { return kept_end[i]->quadric.weight; });
    const Lanes gone_weight = lanesOf<Lanes>([&](std::size_t i) { return gone_end[i]->quadric.weight; });
    const Lanes smaller = gone_weight < kept_weight ? gone_weight : kept_weight;
    const auto distance2 = [](const glm::vec3& d) { return glm::dot(d, d); };
    const Lanes normals2 =
        lanesOf<Lanes>([&](std::size_t i) { return distance2(kept_end[i]->normal - gone_end[i]->normal); });
    const Lanes colors2 =
        lanesOf<Lanes>([&](std::size_t i) { return distance2(kept_end[i]->color - gone_end[i]->color); });
    const Lanes attributes =
        smaller * (normal_scale_ * normal_scale_ * normals2 + color_scale_ * color_scale_ * colors2);
    const Lanes weight = kept_weight + gone_weight;
    const Lanes short_first = kShortFirst * length2 * weight;
    const Lanes fans = weight / small_fans_;
    const Lanes sized = fans < kMinShare ? Lanes{} + kMinShare : fans < one ? fans : one;
    const Lanes cost =
        (added + attributes + short_first) / lanesOf<Lanes>([&](std::size_t i) { return std::sqrt(sized[i]); });

    for (std::size_t i = 0; i < kLanes; ++i) {
      PlannedEdge& edge = *edges[i];
      edge.planned = collapses_ & 0x7fffffffU;
      edge.cost = static_cast<float>(cost[i]);
      edge.position = {static_cast<float>(place.x[i]), static_cast<float>(place.y[i]), static_cast<float>(place.z[i])};
      edge.along = static_cast<float>(taken_at[i]);
    }
  }

  // On flat surfaces every collapse costs nothing. This share of the edge's length decides there: collapsing short
  // edges first leaves triangles of about equal sides. Elsewhere it does not matter: an edge of a thousand lattice
  // steps costs a tenth of a step.
  static constexpr double kShortFirst = 1e-8;
  // A vertex that is placed more than this many edge lengths from the edge's middle comes from an ill-conditioned
  // system.
  static constexpr double kMaxPlacementReach = 2.0;
  // The least share of small fans that counts; it keeps the costs of fans without area finite.
  static constexpr double kMinShare = 1e-4;

  const std::vector<QuadricVertex>& vertices_;
  const std::vector<VertexKind>& kinds_;
  const std::uint32_t& collapses_;
  double small_fans_ = 1.0;
  double normal_scale_ = 0.0;
  double color_scale_ = 0.0;
};

}  // namespace lod::patch::builder

#pragma GCC diagnostic pop
