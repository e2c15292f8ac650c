#pragma once
// Lays one surface over another as a whole, and so bounds the distance in both directions at once.
//
// Every vertex of the upper surface is placed on a facet of the lower, and every edge is walked from facet to facet
// between those of its ends. Where it crosses an edge below, a point of the one is paired with a point of the other.
// A vertex below that the walks around an upper triangle enclose is paired with a point of that triangle.
//
// The pairs cut both surfaces into cells. The cell of upper triangle s and lower facet t is bounded by arcs of the
// edges of s on t and of the edges of t on s. If both sets of arcs close (modulo 2), the cells on s together have the
// border of s as their border, so they cover s, and those on t cover t, wherever the pairs lie. Filled in from one of
// its corners, linearly on both sides, a cell lies in s and in t, which are convex. The distance between its two images
// is largest at a corner, which is a pair, and so is the difference of their colours. So no point of a cell is farther
// from its partner than the largest pair of the cell. The way that the walks take changes how tight this is, never that
// it holds.
//
// There is no cell beyond a border. So a border edge above is walked along a border below, and there the arcs of the
// one must make up the whole of the other. Where they do not, the facet at that edge below stays uncovered.
//
// At a vertex that is the same in both surfaces, walks begin and end in any of the facets around it. Each triangle
// above closes its border there by turning its corner from the facet of its one walk to that of the other: these are
// pairs of the vertex with itself, over edges below that are met at their very end. Each edge must be met there an odd
// number of times, or its end must be enclosed.
//
// Cohen, Manocha and Olano 1997 ("Simplifying Polygonal Models Using Successive Mappings") project every collapse onto
// a plane instead.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "lod/patch/builder/facet_surface.h"

namespace lod::patch::builder {

class Overlay {
 public:
  /// The distance of two points, and of their colours (0 … 255 a channel, Euclidean; 0 where one surface has none).
  struct Gap {
    float distance = 0.0F;
    float color = 0.0F;
  };

  /// Lays `above` over `below`. Per vertex v of `above`: it lies over facet facet_of[v] of `below`, at most gap_of[v]
  /// from it. If it is at the same place as vertex twin_of[v] of `below`, facet_of[v] is one of the facets there;
  /// kNone: it is at no such place. A vertex on a border may lie on border edge border_of[v] of that facet; kNone: on
  /// none.
  void compute(FacetSurface& above, FacetSurface& below, std::span<const std::uint32_t> facet_of,
               std::span<const Gap> gap_of, std::span<const std::uint32_t> twin_of,
               std::span<const std::uint32_t> border_of);

  /// Whether the pairs bound the distance of triangle s of `above`.
  bool coversAbove(std::uint32_t s) const { return is_good_[s] != 0; }
  /// The distance of the largest pair of s.
  float distance(std::uint32_t s) const { return distance_[s]; }
  /// Whether every point of facet t below lies in a cell of some triangle with coversAbove().
  bool coversBelow(std::uint32_t t) const { return is_uncovered_[t] == 0; }

  /// Calls with(v, distance) for each vertex of `below` that a triangle above encloses, with its distance from the
  /// triangle.
  template <class Do>
  void forEachEnclosed(Do&& with) const {
    for (const EnclosedVertex& e : enclosed_) with(e.vertex, e.gap.distance);
  }

  /// Calls with(t, gap) for each pair on edge e of `above` and each facet t whose cells it belongs to, several times
  /// for most facets. All triangles at e have these pairs.
  template <class Do>
  void forEachPairOfEdge(std::uint32_t e, Do&& with) const {
    const Path& path = paths_[e];
    const auto [a, b] = above_->edges()[e].vertex;
    std::uint32_t t = path.start;
    Gap came = gap_of_[a];
    for (std::uint32_t i = path.first; i < path.last; ++i) {
      const EdgeCrossing& crossing = crossings_[i];
      with(t, larger(came, crossing.gap));
      t = crossing.facet, came = crossing.gap;
    }
    with(t, larger(came, gap_of_[b]));
  }
  /// The same for the pairs within triangle s, which are not on its edges.
  template <class Do>
  void forEachPairWithin(std::uint32_t s, Do&& with) const {
    for (std::uint32_t i = first_enclosed_[s]; i < first_enclosed_[s + 1]; ++i)
      for (const std::uint32_t t : below_->around(enclosed_[i].vertex)) with(t, enclosed_[i].gap);
    for (std::uint32_t i = first_corner_facet_[s]; i < first_corner_facet_[s + 1]; ++i)
      with(corner_facets_[i].facet, corner_facets_[i].gap);
  }

 private:
  static constexpr std::uint32_t kNone = FacetSurface::kNone;

  /// An edge above goes over an edge below, which crossed_ names, into a facet.
  struct EdgeCrossing {
    std::uint32_t facet = 0;
    Gap gap;
  };
  struct Path {
    std::uint32_t start = 0;  // facet
    std::uint32_t end = 0;    // facet, if it arrives
    std::uint32_t first = 0;  // crossings
    std::uint32_t last = 0;
    float distance = 0.0F;  // distance of the largest pair
    bool arrives = false;
    bool is_on_border = false;  // never leaves the border below
  };
  /// A vertex below that lies within a triangle above.
  struct EnclosedVertex {
    std::uint32_t vertex = 0;
    Gap gap;
  };

  /// The corner of a triangle above, at a vertex that both surfaces have, turns through this facet.
  struct CornerFacet {
    std::uint32_t facet = 0;
    Gap gap;
  };
  /// A step around a vertex below: over an edge, into a facet.
  struct Step {
    std::uint32_t edge = 0;
    std::uint32_t facet = 0;
  };
  /// The end of a walk: a facet, or any facet at a vertex below.
  struct Goal {
    std::uint32_t facet = 0;
    std::uint32_t twin = kNone;
  };

  static Gap larger(const Gap& a, const Gap& b) {
    return {std::max(a.distance, b.distance), std::max(a.color, b.color)};
  }

  void walkEdge(std::uint32_t e, Path& path);
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
  bool findSameEdge(std::uint32_t e, Path& path) const;
  void addCrossing(std::uint32_t edge, std::uint32_t facet, float along);
  void measureCrossings();
  const std::vector<Step>* findWayAround(std::uint32_t t, std::uint32_t goal, std::uint32_t v);
  bool linkFacets(std::uint32_t t, const Goal& goal, float along);
  bool encloseVertices(std::uint32_t s);
  bool turnCorners(std::uint32_t s);
  std::uint32_t endAt(std::uint32_t e, std::uint32_t v) const;
  bool isAllCut(std::uint32_t v) const;
  bool addConnected(std::uint32_t start, std::size_t max_vertices);
  void findUncovered();
  void uncoverAround(const FacetSurface::Edge& edge);
  void findCoveredBorders();

  FacetSurface* above_ = nullptr;
  FacetSurface* below_ = nullptr;
  std::span<const std::uint32_t> facet_of_;
  std::span<const Gap> gap_of_;
  std::span<const std::uint32_t> twin_of_;
  std::span<const std::uint32_t> border_of_;
  bool has_color_ = false;
  std::vector<Path> paths_;  // per edge above
  std::vector<EdgeCrossing> crossings_;
  std::vector<std::uint32_t> crossed_;  // beside crossings_: edges below; apart, since most loops read these alone
  std::vector<EnclosedVertex> enclosed_;
  std::vector<std::uint32_t> first_enclosed_;
  std::vector<CornerFacet> corner_facets_;
  std::vector<std::uint32_t> first_corner_facet_;
  std::vector<float> distance_;
  std::vector<std::uint8_t> is_good_;
  std::vector<std::uint8_t> is_uncovered_;
  std::vector<std::uint8_t> is_enclosed_;  // per vertex below: by an odd number of covered triangles
  std::vector<std::uint8_t> is_turned_;    // per edge below, a bit per end: an odd number of corners turns over it
  /// An edge above goes around a border vertex below, from one border edge to the next, or begins or ends there.
  struct BorderTurn {
    std::uint32_t above = 0;
    std::uint32_t vertex = 0;
    std::uint32_t from = 0;
    std::uint32_t to = kNone;  // kNone: it ends at the vertex
    std::uint32_t first = 0;   // crossings
    std::uint32_t last = 0;
  };
  std::vector<BorderTurn> turns_;
  /// Per vertex above: an odd number of walks along the border end there, between vertices below.
  std::vector<std::uint8_t> is_open_end_;
  /// Per border edge below, a bit per end: an odd number of walks goes around it or ends there.
  std::vector<std::uint8_t> covered_ends_;
  // Crossings that wait for their gaps. They lie value by value, so that the compiler measures eight at once.
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
    Lanes along{};                               // the share of the edge above, for parallel edges
    LanePoints above;                            // from one end of the edge above to the other
    LanePoints below;                            // from one end of the edge below to the other
    LanePoints apart;                            // from the first end above to the first end below
    LanePoints color_above[2];
    LanePoints color_below[2];
  };
  CrossingLanes lanes_;
  // The following describe the current walk or triangle.
  std::uint32_t walked_ = 0;  // edge above
  glm::vec3 origin_{0.0F};
  glm::vec3 whole_{0.0F};
  float length2_ = 0.0F;
  std::vector<std::uint32_t> cut_;  // edges below that lead in or out of the triangle
  std::vector<std::uint8_t> is_cut_;
  std::vector<std::uint32_t> inside_;
  /// A corner turns over an edge below at this vertex of it.
  struct CornerTurn {
    std::uint32_t edge = 0;
    std::uint32_t vertex = 0;
  };
  std::vector<CornerTurn> corners_;
  std::vector<Step> way_[2];
};

}  // namespace lod::patch::builder
