#pragma once
// Lays one surface over another as a whole, and so bounds the distance both ways at once.
//
// Every vertex of the upper surface is put on a facet of the lower, and every edge is walked from facet to facet
// between those of its ends. Where it crosses an edge below, a point of the one is paired with a point of the other.
// A vertex below that the walks around an upper triangle enclose is paired with a point of that triangle.
//
// The pairs cut both surfaces into cells: what belongs to upper triangle s and lower facet t is bounded by arcs of the
// edges of s on t and of the edges of t on s. If both sets of arcs close (modulo 2), the cells on s together have the
// border of s as their border, so they cover it, and those on t cover t, wherever the pairs lie. Filled in from one of
// its corners, linearly on both sides, a cell lies in s and in t, which are convex; and the distance between its two
// pictures is largest at a corner, a pair; so is that of their colours. So no point of a cell is farther from its
// partner than the largest pair of the cell. How the walks were made changes how tight that is, never that it holds.
//
// Beyond a border is no cell. So a border edge above is walked along a border below, and there the arcs of the one must
// make up the whole of the other. Where they don't, nothing is said about the facet at that edge below.
//
// At a vertex that is the same in both, walks begin and end in any of the facets around it. Each triangle above closes
// its border there by a turn of its corner, from the facet of its one walk to that of the other: pairs of the vertex
// with itself, over edges below that are so met at their very end. Each edge must be met there an odd number of times,
// or its end be enclosed.
//
// Compare the successive mappings of Cohen, Manocha and Olano 1997, which project every collapse onto a plane.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lod/patch/builder/facet_surface.h"

namespace lod::patch::builder {

class Overlay {
 public:
  /// What two points are apart: in space, and in colour (0 … 255 a channel; 0 where one surface has none).
  struct Gap {
    float distance = 0.0F;
    float color = 0.0F;
  };

  /// Vertex v of `above` lies over facet facet_of[v] of `below`, at most gap_of[v] from it. A vertex at the same place
  /// as vertex twin_of[v] of `below` lies over one of the facets there; kNone: at none. A vertex on a border may lie on
  /// border edge border_of[v] of that facet; kNone: on none.
  void make(FacetSurface& above, FacetSurface& below, std::span<const std::uint32_t> facet_of,
            std::span<const Gap> gap_of, std::span<const std::uint32_t> twin_of,
            std::span<const std::uint32_t> border_of);

  /// Do the pairs prove anything about triangle s of `above`?
  bool coversAbove(std::uint32_t s) const { return is_good_[s] != 0; }
  /// The largest pair of s.
  float distance(std::uint32_t s) const { return distance_[s]; }
  /// Are all points of facet t below in cells of triangles that coversAbove() says yes to?
  bool coversBelow(std::uint32_t t) const { return is_bare_[t] == 0; }

  /// Calls with(v, distance) for each vertex of `below` that a triangle above encloses, with its distance from that.
  template <class Do>
  void forEachEnclosed(Do&& with) const {
    for (const Enclosed& e : enclosed_) with(e.vertex, e.gap.distance);
  }

  /// Calls with(t, gap) for each pair on edge e of `above` and each facet whose cells it belongs to; several times for
  /// most facets. These are pairs of all triangles at e.
  template <class Do>
  void forEachPairOfEdge(std::uint32_t e, Do&& with) const {
    const Path& path = paths_[e];
    const auto [a, b] = above_->edges()[e].vertex;
    std::uint32_t t = path.start;
    Gap came = gap_of_[a];
    for (std::uint32_t i = path.first; i < path.last; ++i) {
      const Crossing& crossing = crossings_[i];
      with(t, larger(came, crossing.gap));
      t = crossing.facet, came = crossing.gap;
    }
    with(t, larger(came, gap_of_[b]));
  }
  /// The same for the pairs within triangle s.
  template <class Do>
  void forEachPairWithin(std::uint32_t s, Do&& with) const {
    for (std::uint32_t i = first_enclosed_[s]; i < first_enclosed_[s + 1]; ++i)
      for (const std::uint32_t t : below_->around(enclosed_[i].vertex)) with(t, enclosed_[i].gap);
    for (std::uint32_t i = first_passed_[s]; i < first_passed_[s + 1]; ++i) with(passed_[i].facet, passed_[i].gap);
  }

 private:
  static constexpr std::uint32_t kNone = FacetSurface::kNone;

  /// An edge above goes over an edge below (crossed_), into a facet.
  struct Crossing {
    std::uint32_t facet = 0;
    Gap gap;
  };
  struct Path {
    std::uint32_t start = 0;  // facet
    std::uint32_t end = 0;    // facet, if it arrives
    std::uint32_t first = 0;  // crossings
    std::uint32_t last = 0;
    float distance = 0.0F;  // the largest
    bool arrives = false;
    bool is_on_border = false;  // never leaves the border below
  };
  /// A vertex below that lies within a triangle above.
  struct Enclosed {
    std::uint32_t vertex = 0;
    Gap gap;
  };

  /// A corner above that is the same below turns through this facet there.
  struct Passed {
    std::uint32_t facet = 0;
    Gap gap;
  };
  /// One step around a vertex below: over an edge, into a facet.
  struct Step {
    std::uint32_t edge = 0;
    std::uint32_t facet = 0;
  };
  /// Where a walk goes: to a facet, or to any at a vertex below.
  struct Goal {
    std::uint32_t facet = 0;
    std::uint32_t twin = kNone;
  };

  static Gap larger(const Gap& a, const Gap& b) {
    return {std::max(a.distance, b.distance), std::max(a.color, b.color)};
  }

  void walk(std::uint32_t e, Path& path);
  // Is this the facet of the goal, or any at its vertex?
  bool isReached(const Goal& goal, std::uint32_t t) const {
    if (goal.twin == kNone) return t == goal.facet;
    return below_->corner(t, 0) == goal.twin || below_->corner(t, 1) == goal.twin || below_->corner(t, 2) == goal.twin;
  }
  std::uint32_t facetToward(std::uint32_t v);
  bool walkBorder(std::uint32_t e, Path& path);
  bool walkBorderFrom(std::uint32_t e, std::uint32_t at, std::uint32_t v, Path& path);
  std::uint32_t borderBetween(std::uint32_t v, std::uint32_t w) const;
  std::uint8_t endBit(std::uint32_t e, std::uint32_t v) const;
  Gap gapAt(std::uint32_t v, const FacetSurface::Edge& edge) const;
  std::uint32_t nextOnBorder(std::uint32_t edge, std::uint32_t end) const;
  bool isSame(std::uint32_t e, Path& path) const;
  void cross(std::uint32_t edge, std::uint32_t facet, float along);
  void measureCrossings();
  const std::vector<Step>* turn(std::uint32_t t, std::uint32_t goal, std::uint32_t v);
  bool link(std::uint32_t t, const Goal& goal, float along);
  bool enclose(std::uint32_t s);
  bool turnCorners(std::uint32_t s);
  std::uint32_t endAt(std::uint32_t e, std::uint32_t v) const;
  bool isAlone(std::uint32_t v) const;
  bool flood(std::uint32_t start, std::size_t most);
  void findBare();
  void bareAround(const FacetSurface::Edge& edge);
  void findPinned();

  FacetSurface* above_ = nullptr;
  FacetSurface* below_ = nullptr;
  std::span<const std::uint32_t> facet_of_;
  std::span<const Gap> gap_of_;
  std::span<const std::uint32_t> twin_of_;
  std::span<const std::uint32_t> border_of_;
  bool has_color_ = false;
  std::vector<Path> paths_;  // per edge above
  std::vector<Crossing> crossings_;
  std::vector<std::uint32_t> crossed_;  // edges below: what triangles above look at alone, so that it stays in cache
  std::vector<Enclosed> enclosed_;
  std::vector<std::uint32_t> first_enclosed_;
  std::vector<Passed> passed_;
  std::vector<std::uint32_t> first_passed_;
  std::vector<float> distance_;
  std::vector<std::uint8_t> is_good_;
  std::vector<std::uint8_t> is_bare_;
  std::vector<std::uint8_t> is_enclosed_;  // per vertex below: by an odd number of good triangles
  std::vector<std::uint8_t> is_turned_;    // per edge below: over what ends of it an odd number of corners turns
  // An edge above goes around a border vertex below, from one border edge to the next, or begins or ends there.
  struct Turn {
    std::uint32_t above = 0;
    std::uint32_t vertex = 0;
    std::uint32_t from = 0;
    std::uint32_t to = kNone;  // kNone: it ends at the vertex
    std::uint32_t first = 0;   // crossings
    std::uint32_t last = 0;
  };
  std::vector<Turn> turns_;
  std::vector<std::uint8_t>
      is_loose_;  // per vertex above: an odd number of walks along the border end there, between vertices
  std::vector<std::uint8_t> is_passed_;  // per edge below: of what ends of it an odd number of walks goes around
  // Crossings that wait for their gaps, value by value: the compiler measures them in step.
  static constexpr std::size_t kLanes = 8;
  using Lanes = std::array<float, kLanes>;
  struct LanePoints {
    Lanes x{};
    Lanes y{};
    Lanes z{};
    void set(std::size_t lane, const glm::vec3& p) { x[lane] = p.x, y[lane] = p.y, z[lane] = p.z; }
  };
  struct CrossingLanes {
    std::size_t count = 0;
    std::array<std::uint32_t, kLanes> crossing{};
    std::array<std::uint32_t, kLanes> walked{};  // edge above
    Lanes along{};                               // the share of it
    LanePoints above;                            // from one end of it to the other
    LanePoints below;                            // the same
    LanePoints apart;                            // from the first end above to the first below
    LanePoints color_above[2];
    LanePoints color_below[2];
  };
  CrossingLanes lanes_;
  // Of the walk or the triangle at hand.
  std::uint32_t walked_ = 0;  // edge above
  glm::vec3 origin_{0.0F};
  glm::vec3 whole_{0.0F};
  float length2_ = 0.0F;
  std::vector<std::uint32_t> cut_;  // edges below that go in or out
  std::vector<std::uint8_t> is_cut_;
  std::vector<std::uint32_t> inside_;
  // A corner turns over an edge below at this vertex of it.
  struct Corner {
    std::uint32_t edge = 0;
    std::uint32_t vertex = 0;
  };
  std::vector<Corner> corners_;
  std::vector<Step> way_[2];
};

}  // namespace lod::patch::builder
