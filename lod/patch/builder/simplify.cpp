#include "lod/patch/builder/simplify.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "base/geometry.h"
#include "base/simd.h"
#include "lod/ingest/disjoint_sets.h"
#include "lod/patch/builder/edge_planner.h"
#include "lod/patch/builder/edge_queue.h"
#include "lod/patch/builder/point_grid.h"
#include "lod/patch/builder/quadric.h"

// Vectors of four doubles are passed only to functions that become part of their caller: no ABI says how.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace lod::patch::builder {
namespace {

// The weights and shares here are choices. They were made while building the scans and generated meshes of
// docs/results/hierarchy.md and comparing the mean and the largest distance of the levels. Figures were kept for
// kSmallFans and for costs (docs/decisions/collapse-cost.md) and for kFolded (docs/decisions/needles.md), for the
// others not.

// Planes upright on border edges weigh this much more than a triangle of the same edge length. Without that, seams
// between the tiles of a scan erode and open as gaps. A larger weight leaves more of the triangles to borders.
constexpr double kBorderWeight = 10.0;
// Thin strips and beams have hardly any area, so their ends could slide at hardly any cost. A vertex whose triangles
// cover less than kThinFan of their longest edge's square is tied to its place by a point quadric of this share of a
// mean edge's square. Larger values keep more of thin parts and leave fewer triangles to the rest.
constexpr double kThinFan = 0.3;
constexpr double kPointWeight = 5e-3;
// Quadrics are weighted by area, so collapsing the tip of a small fan costs almost nothing, yet it can move the surface
// far; such tips dominated the largest errors. Where both fans of an edge together cover less than kSmallFans mean
// fans, costs are divided by the square root of the share that they do cover. Small fans are few, so the mean distance
// hardly changes.
constexpr double kSmallFans = 2.0;
// The planes of a spike's sides all contain its axis, so quadrics do not tell how far it sticks out. Where the vector
// sum of a fan's areas is less than this share of their plain sum, distances are measured instead, which takes longer.
constexpr double kFolded = 0.6;
// A change of colour from black to white costs like a distance of kColorLength mean edges, a normal turned by 60
// degrees like one of kNormalLength. Larger lengths follow the attributes more closely and the shape less.
constexpr double kColorLength = 0.25;
constexpr double kNormalLength = 0.02;
// The first two stages refuse a collapse that turns a triangle by more than the angle of this cosine, 75.5 degrees. A
// smaller angle leaves more collapses to the last stage, which refuses none.
constexpr double kMinTurnCosine = 0.25;
// A stage ends when a round removes less than a fiftieth of the triangles. A smaller share takes more rounds before the
// next stage lifts a condition.
constexpr std::size_t kMinProgress = 50;

// The conditions that a stage puts on a collapse. It also ends when the next collapse would move the surface by more
// than `max_move` (root mean square, in mean edges): from there on a collapse without the condition does less harm.
// Larger limits keep topology and orientation for longer, at the cost of larger distances.
struct StageConditions {
  bool keep_topology = true;
  bool keep_orientation = true;
  double max_move = 0.0;
};
constexpr std::array<StageConditions, 3> kStages{{{true, true, 0.5}, {false, true, 1.5}, {false, false, 1e30}}};

// A collapse of an edge: vertex `gone` becomes one with vertex `kept`.
struct Collapse {
  std::uint32_t gone = 0;
  std::uint32_t kept = 0;
  glm::vec3 position{0.0F};
  float along = 0.0F;         // 0 at kept, 1 at gone: where attributes are taken
  float displacement = 0.0F;  // how far the surface leaves what it stood for; measured where it is folded or vanishes
};

glm::dvec3 crossOf(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  return glm::cross(glm::dvec3(b) - glm::dvec3(a), glm::dvec3(c) - glm::dvec3(a));
}

class Simplifier {
 public:
  Simplifier(const GroupMesh& mesh, const FacetSurface& surface, std::size_t target)
      : mesh_(mesh), positions_(mesh.positions), surface_(surface), target_(std::max<std::size_t>(1, target)) {}

  SimplifiedGroup run() {
    buildFans();
    findEdges();
    addTriangleQuadrics();
    live_ = triangles_.size();

    // A stage is repeated while edges that it refused earlier become possible; then the next one begins.
    std::size_t stage = 0;
    for (;;) {
      const std::size_t before = live_;
      collapseAll(kStages[stage]);
      if (live_ <= target_) break;
      const bool last = stage + 1 == kStages.size();
      if (last && live_ == before) break;
      if (!last && before - live_ < std::max<std::size_t>(1, before / kMinProgress)) ++stage;
      refillQueue();
    }
    return result(stage > 0);
  }

 private:
  struct Triangle {
    std::array<std::uint32_t, 3> corner{};
    std::uint32_t alive = 1;  // or 0
  };
  // One of a triangle's corners.
  struct Corner {
    std::uint32_t triangle : 30 = 0;
    std::uint32_t place : 2 = 0;
  };
  struct Fan {
    std::uint32_t first = 0;
    std::uint32_t count = 0;
  };

  // Fans are ranges of one pool; a collapse appends the joined fan at its end.
  void buildFans() {
    const std::span<const std::uint32_t> indices = surface_.view().indices;
    triangles_.resize(indices.size() / 3);
    for (std::size_t t = 0; t < triangles_.size(); ++t)
      triangles_[t].corner = {indices[3 * t], indices[3 * t + 1], indices[3 * t + 2]};
    const std::size_t vertices = positions_.size();
    fans_.resize(vertices);
    pool_.reserve(3 * indices.size());
    for (std::uint32_t v = 0; v < vertices; ++v) {
      const auto around = surface_.around(v);
      fans_[v] = {static_cast<std::uint32_t>(pool_.size()), static_cast<std::uint32_t>(around.size())};
      for (const std::uint32_t t : around) {
        const auto& c = triangles_[t].corner;
        pool_.push_back({.triangle = t, .place = (c[1] == v ? 1U : 0U) + (c[2] == v ? 2U : 0U)});
      }
    }
    survivor_.resize(vertices);
    for (std::uint32_t v = 0; v < vertices; ++v) survivor_[v] = v;
    mark_.assign(vertices, 0);
    changed_.assign(vertices, 0);
  }

  // Lists every edge that may be collapsed, and classifies vertices by the edges' numbers of triangles.
  void findEdges() {
    const std::size_t vertices = positions_.size();
    kinds_.assign(vertices, VertexKind::kInterior);
    vertices_.assign(vertices, {});
    for (std::uint32_t v = 0; v < vertices; ++v) {
      if (mesh_.locked[v] != 0) kinds_[v] = VertexKind::kLocked;
      vertices_[v].position = positions_[v];
      vertices_[v].normal = mesh_.normals[v];
      if (!mesh_.colors.empty()) vertices_[v].color = mesh_.colors[v];
    }
    edges_.reserve(surface_.edges().size());
    double length_sum = 0.0;
    for (const FacetSurface::Edge& edge : surface_.edges()) {
      const auto [v, w] = edge.vertex;
      if (mesh_.locked[v] != 0 && mesh_.locked[w] != 0) continue;
      length_sum += glm::length(positions_[v] - positions_[w]);
      edges_.push_back({.a = v, .b = w});
      if (edge.triangles != 2) markBorderEdge(v, w);
    }
    const double mean =
        edges_.empty() ? 1.0 : length_sum / static_cast<double>(std::max<std::size_t>(1, edges_.size()));
    mean_edge_ = mean;
  }

  // The vertices of higher numbers that share a triangle with v, each once.
  void neighborsAbove(std::uint32_t v, std::vector<std::uint32_t>& neighbors) {
    neighbors.clear();
    ++stamp_;
    forEachTriangle(v, [&](std::uint32_t t) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t w = triangles_[t].corner[k];
        if (w <= v) continue;
        if (mark_[w] != stamp_) mark_[w] = stamp_, neighbors.push_back(w);
      }
    });
  }

  // Includes corners of triangles that have vanished.
  std::span<const Corner> cornersAround(std::uint32_t v) const {
    return {pool_.data() + fans_[v].first, fans_[v].count};
  }

  template <class Body>
  void forEachTriangle(std::uint32_t v, Body&& body) const {
    for (const Corner& c : cornersAround(v))
      if (triangles_[c.triangle].alive != 0) body(c.triangle);
  }

  // Whether a living triangle uses v.
  bool isUsed(std::uint32_t v) const {
    const auto fan = cornersAround(v);
    return std::any_of(fan.begin(), fan.end(), [&](const Corner& c) { return triangles_[c.triangle].alive != 0; });
  }

  bool touches(std::uint32_t t, std::uint32_t v) const {
    const auto& c = triangles_[t].corner;
    return c[0] == v || c[1] == v || c[2] == v;
  }

  void markBorderEdge(std::uint32_t v, std::uint32_t w) {
    for (const std::uint32_t end : {v, w})
      if (kinds_[end] == VertexKind::kInterior) kinds_[end] = VertexKind::kBorder;
    forEachTriangle(v, [&](std::uint32_t t) {
      if (touches(t, w)) addBorderQuadric(v, w, t);
    });
  }

  // Adds the plane through the edge, perpendicular to the triangle, which keeps a border in its place.
  void addBorderQuadric(std::uint32_t v, std::uint32_t w, std::uint32_t t) {
    const glm::dvec3 from(positions_[v]);
    const glm::dvec3 edge = glm::dvec3(positions_[w]) - from;
    glm::dvec3 n = glm::cross(edge, triangleNormal(t));
    const double length = glm::length(n);
    if (length == 0.0) return;
    n /= length;
    const double weight = kBorderWeight * glm::dot(edge, edge);
    vertices_[v].quadric.addPlane(n, -glm::dot(n, from), weight);
    vertices_[w].quadric.addPlane(n, -glm::dot(n, from), weight);
  }

  glm::dvec3 triangleNormal(std::uint32_t t) const {
    const auto& c = triangles_[t].corner;
    return crossOf(positions_[c[0]], positions_[c[1]], positions_[c[2]]);
  }

  // The triangles around a vertex together.
  struct FanShape {
    glm::dvec3 vector_area{0.0};
    double longest2 = 0.0;  // the longest edge, squared
  };

  void addTriangleQuadrics() {
    std::vector<FanShape> shapes(vertices_.size());
    // The planes of two triangles are computed at once and added one after the other.
    for (std::size_t t = 0; t < triangles_.size(); t += 2) {
      const std::array<const Triangle*, 2> two{&triangles_[t], &triangles_[std::min(t + 1, triangles_.size() - 1)]};
      const auto place = [&](std::size_t k) {
        return pairOf(positions_[two[0]->corner[k]], positions_[two[1]->corner[k]]);
      };
      const PairPoint p = place(0);
      const PairPoint q = place(1);
      const PairPoint r = place(2);
      const std::array<PairPoint, 3> edges{q - p, r - q, p - r};
      const std::array<base::Double2, 3> length2{dot(edges[0], edges[0]), dot(edges[1], edges[1]),
                                                 dot(edges[2], edges[2])};
      PairPoint n = cross(edges[2], edges[0]);
      const base::Double2 length2_of_n = dot(n, n);
      const base::Double2 length{std::sqrt(length2_of_n[0]), std::sqrt(length2_of_n[1])};
      n = {n.x / length, n.y / length, n.z / length};
      const PlanePair planes(n, -dot(n, p), 0.5 * length);
      for (std::size_t i = 0; i < std::min<std::size_t>(2, triangles_.size() - t); ++i) {
        const auto& c = two[i]->corner;
        for (std::size_t k = 0; k < 3; ++k)
          shapes[c[k]].longest2 = std::max({shapes[c[k]].longest2, length2[k][i], length2[(k + 2) % 3][i]});
        if (length[i] == 0.0) continue;
        const double area = 0.5 * length[i];
        for (std::size_t k = 0; k < 3; ++k) {
          planes.addTo(vertices_[c[k]].quadric, i);
          shapes[c[k]].vector_area += area * glm::dvec3(n.x[i], n.y[i], n.z[i]);
        }
      }
    }
    findFolds(shapes);
    tieThinFans(shapes);
    queueEdges();
  }

  void findFolds(const std::vector<FanShape>& shapes) {
    folded_.assign(vertices_.size(), 0);
    displacement_.assign(vertices_.size(), 0.0F);
    double sum = 0.0;
    std::size_t free = 0;
    for (std::size_t v = 0; v < vertices_.size(); ++v) {
      const double area = vertices_[v].quadric.weight;
      folded_[v] = glm::length(shapes[v].vector_area) < kFolded * area ? 1 : 0;
      if (kinds_[v] != VertexKind::kLocked) sum += area, ++free;
    }
    mean_fan_ = sum / static_cast<double>(std::max<std::size_t>(1, free));
    planner_.setScales(mean_fan_ > 0.0 ? kSmallFans * mean_fan_ : 1.0, kNormalLength * mean_edge_,
                       kColorLength * mean_edge_ / 255.0);
  }

  void tieThinFans(const std::vector<FanShape>& shapes) {
    for (std::size_t v = 0; v < vertices_.size(); ++v)
      if (vertices_[v].quadric.weight < kThinFan * shapes[v].longest2)
        vertices_[v].quadric.addPoint(glm::dvec3(positions_[v]), kPointWeight * mean_edge_ * mean_edge_);
  }

  void queueEdges() {
    queue_.reset(edges_.size());
    constexpr std::size_t kRun = 512;  // so many edges are still in the nearest cache when they are pushed
    for (std::size_t first = 0; first < edges_.size(); first += kRun) {
      const std::span<PlannedEdge> run = std::span(edges_).subspan(first, std::min(kRun, edges_.size() - first));
      planner_.planAll(run.size(), [&](std::size_t i) -> PlannedEdge& { return run[i]; });
      for (std::size_t i = 0; i < run.size(); ++i) queue_.push(run[i].cost, static_cast<std::uint32_t>(first + i));
    }
  }

  // Queues all edges of the living triangles.
  void refillQueue() {
    grid_.reset();  // many of its vertices are gone by now
    edges_.clear();
    std::vector<std::uint32_t> neighbors;
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) {
      if (survivor_[v] != v) continue;
      neighborsAbove(v, neighbors);
      for (const std::uint32_t w : neighbors)
        if (kinds_[v] != VertexKind::kLocked || kinds_[w] != VertexKind::kLocked) edges_.push_back({.a = v, .b = w});
    }
    queueEdges();
  }

  // Collapses edges, cheapest first. Quadrics only grow, so costs seldom fall: a cost is computed anew when the edge's
  // turn comes, and the edge waits again if it has become dearer.
  void collapseAll(const StageConditions& stage) {
    // Costs are squared distances times an area, and a mean edge's square stands for that area.
    const double max_cost = stage.max_move * stage.max_move * mean_edge_ * mean_edge_ * mean_edge_ * mean_edge_;
    while (live_ > target_ && fillQueue() && queue_.lowest() <= max_cost) {
      const EdgeQueue::Entry entry = queue_.top();
      PlannedEdge& edge = edges_[entry.edge];
      findEnds(edge);
      if (edge.a == edge.b) {
        queue_.pop();
        continue;
      }
      const EdgeQueue::Entry next = queue_.second();
      prefetchAround(edge, edges_[next.edge]);
      if (isStale(edge)) {
        PlannedEdge& other = edges_[next.edge];
        findEnds(other);
        planner_.planTwo(edge, isStale(other) ? other : edge);
      }
      if (edge.cost > entry.cost && edge.cost > next.cost) {
        queue_.raiseTop(edge.cost);
        continue;
      }
      queue_.pop();
      gatherNeighborhood(edge.a, edge.b);
      const std::size_t triangles = around_.on_edge.size();
      if (triangles == 0) continue;
      const bool as_border = triangles != 2 || !stage.keep_topology;
      if (EdgePlanner::keptEndOf(kinds_[edge.a], kinds_[edge.b], as_border) == KeptEnd::kNone) continue;
      if (stage.keep_topology && around_.common != triangles) continue;
      Collapse collapse{edge.keeps_a != 0 ? edge.b : edge.a, edge.keeps_a != 0 ? edge.a : edge.b, edge.position,
                        edge.along};
      if (flips(collapse.position, stage.keep_orientation)) continue;
      if (live_ <= triangles) continue;
      const bool meets = countBetween(around_.around_a) + countBetween(around_.around_b) >= 2;
      if (isFolded(collapse) || meets || losesThirdCorner(collapse)) {
        findLost(collapse);
        collapse.displacement =
            measureDisplacement(collapse, std::sqrt(static_cast<double>(entry.cost) / foldWeight(collapse)));
        if (requeueIfDearer(entry, static_cast<float>(foldCost(collapse)))) continue;
      }
      applyCollapse(collapse);
      if (meets) removeOpposites(collapse.kept);
    }
  }

  // Fans lie anywhere in memory. The triangles of this edge are requested before they are needed, and so is the list of
  // triangles of the next.
  LUMIGRID_ALWAYS_INLINE void prefetchAround(const PlannedEdge& edge, const PlannedEdge& next) const {
    for (const std::uint32_t v : {edge.a, edge.b}) {
      vertices_[v].prefetch();
      for (const Corner& c : cornersAround(v)) __builtin_prefetch(&triangles_[c.triangle]);
    }
    for (const std::uint32_t v : {next.a, next.b}) __builtin_prefetch(cornersAround(v).data());
  }

  SimplifiedGroup result(bool rough) {
    GroupMesh vertices{std::move(positions_), {}, {}, {}, {}};
    vertices.normals.reserve(vertices_.size());
    for (const QuadricVertex& v : vertices_) vertices.normals.push_back(v.normal);
    if (!mesh_.colors.empty()) {
      vertices.colors.reserve(vertices_.size());
      for (const QuadricVertex& v : vertices_) vertices.colors.push_back(v.color);
    }
    return {std::move(vertices), history(rough)};
  }

  // Brings two edges into the queue's heap if there are as many; false if there is none at all. Edges that waited are
  // planned anew first, which sends many of them back to wait.
  bool fillQueue() {
    while (queue_.size() < 2 && queue_.openBucket(opened_)) {
      std::size_t stale = 0;
      forgetEdges(opened_.size());
      for (std::size_t i = 0; i < opened_.size(); ++i) {
        __builtin_prefetch(&edges_[opened_[std::min(i + kEdgesAhead, opened_.size() - 1)].edge]);
        const EdgeQueue::Entry entry = opened_[i];
        PlannedEdge& edge = edges_[entry.edge];
        findEnds(edge);
        if (edge.a == edge.b) continue;
        const bool moved = (changed_[edge.a] | changed_[edge.b]) != 0;
        if (moved && isDuplicate(edge)) continue;
        if (isStale(edge)) {
          opened_[stale++] = entry;
          for (const std::uint32_t v : {edge.a, edge.b}) vertices_[v].prefetch();
        } else {
          queue_.push(entry.cost, entry.edge);
        }
      }
      opened_.resize(stale);
      planner_.planAll(stale, [&](std::size_t i) -> PlannedEdge& { return edges_[opened_[i].edge]; });
      for (const EdgeQueue::Entry& entry : opened_)
        queue_.push(std::max(entry.cost, edges_[entry.edge].cost), entry.edge);
    }
    return queue_.size() != 0;
  }

  // Collapses lay edges on each other. A hash table of the edges' ends tells which of a bucket are duplicates.
  void forgetEdges(std::size_t expected) { known_.assign(std::bit_ceil(2 * expected), kNoEnds); }
  bool isDuplicate(const PlannedEdge& edge) {
    const auto [low, high] = std::minmax(edge.a, edge.b);
    const std::uint64_t ends = std::uint64_t{low} << 32 | high;
    for (std::size_t slot = low * 0x9e3779b1U + high;; ++slot) {
      std::uint64_t& known = known_[slot & (known_.size() - 1)];
      if (known == ends) return true;
      if (known != kNoEnds) continue;
      known = ends;
      return false;
    }
  }

  void findEnds(PlannedEdge& edge) {
    edge.a = find(edge.a);
    edge.b = find(edge.b);
  }
  bool isStale(const PlannedEdge& edge) const { return std::max(changed_[edge.a], changed_[edge.b]) > edge.planned; }

  // Puts an edge back that has become dearer than it was and than the next one.
  bool requeueIfDearer(const EdgeQueue::Entry& entry, float cost) {
    if (queue_.size() == 0 || cost <= entry.cost || cost <= queue_.lowest()) return false;
    queue_.push(cost, entry.edge);
    return true;
  }

  std::uint32_t find(std::uint32_t v) {
    while (survivor_[v] != v) v = survivor_[v] = survivor_[survivor_[v]];
    return v;
  }

  // A living triangle at a vertex, and its two corners behind that vertex.
  struct Wedge {
    Corner corner;
    std::uint32_t second = 0;
    std::uint32_t third = 0;
  };
  // The triangles around an edge. A collapse scatters the fans beside it in memory, so they are read only once.
  struct Neighborhood {
    std::uint32_t a = 0;
    std::uint32_t b = 0;
    std::span<const Wedge> around_a, around_b;  // without the triangles on the edge
    std::span<const std::uint32_t> on_edge;     // the triangles on the edge
    std::uint32_t common = 0;                   // vertices next to both ends
    std::vector<Wedge> wedges_a, wedges_b;      // the spans' memory
    std::vector<std::uint32_t> triangles;
  };

  // Fills around_ and leaves mark_ == stamp_ on the vertices next to both ends. No branch could predict which triangles
  // live: all are written, and the next one is written over those that do not count.
  void gatherNeighborhood(std::uint32_t a, std::uint32_t b) {
    around_.a = a;
    around_.b = b;
    stamp_ += 2;
    const std::uint32_t stamp = stamp_;
    const std::span<const Corner> fan_a = cornersAround(a);
    const std::span<const Corner> fan_b = cornersAround(b);
    if (around_.wedges_a.size() < fan_a.size()) around_.wedges_a.resize(2 * fan_a.size());
    if (around_.wedges_b.size() < fan_b.size()) around_.wedges_b.resize(2 * fan_b.size());
    if (around_.triangles.size() < fan_a.size()) around_.triangles.resize(2 * fan_a.size());
    const Triangle* const triangles = triangles_.data();
    std::uint32_t* const marks = mark_.data();

    Wedge* wedge = around_.wedges_a.data();
    std::uint32_t* on_edge = around_.triangles.data();
    for (const Corner& corner : fan_a) {
      const Triangle& t = triangles[corner.triangle];
      const std::uint32_t second = t.corner[kSecond[corner.place]];
      const std::uint32_t third = t.corner[kThird[corner.place]];
      const std::uint32_t on = t.alive & static_cast<std::uint32_t>((second == b) | (third == b));
      wedge->corner = corner, wedge->second = second, wedge->third = third;
      wedge += t.alive ^ on;
      *on_edge = corner.triangle;
      on_edge += on;
      marks[t.alive != 0 ? second : a] = stamp - 1;
      marks[t.alive != 0 ? third : a] = stamp - 1;
    }
    marks[a] = marks[b] = 0;
    around_.around_a = {around_.wedges_a.data(), wedge};
    around_.on_edge = {around_.triangles.data(), on_edge};

    wedge = around_.wedges_b.data();
    std::uint32_t common = 0;
    for (const Corner& corner : fan_b) {
      const Triangle& t = triangles[corner.triangle];
      const std::uint32_t second = t.corner[kSecond[corner.place]];
      const std::uint32_t third = t.corner[kThird[corner.place]];
      wedge->corner = corner, wedge->second = second, wedge->third = third;
      wedge += t.alive & static_cast<std::uint32_t>((second != a) & (third != a));
      for (const std::uint32_t v : {t.alive != 0 ? second : b, t.alive != 0 ? third : b}) {
        const std::uint32_t next_to_both = marks[v] == stamp - 1 ? 1 : 0;
        marks[v] += next_to_both;
        common += next_to_both;
      }
    }
    around_.around_b = {around_.wedges_b.data(), wedge};
    around_.common = common;
  }
  Wedge wedgeOf(const Corner& corner) const {
    const auto& c = triangles_[corner.triangle].corner;
    return {corner, c[kSecond[corner.place]], c[kThird[corner.place]]};
  }

  // How many of these triangles lie between vertices that are next to both ends, after gatherNeighborhood().
  std::uint32_t countBetween(std::span<const Wedge> wedges) const {
    std::uint32_t between = 0;
    for (const Wedge& w : wedges) between += mark_[w.second] == stamp_ && mark_[w.third] == stamp_ ? 1 : 0;
    return between;
  }

  // How far a triangle by itself is from other components: from that of its corners that is farthest from them.
  struct Lonely {
    double distance2 = -1.0;                 // below 0: not measured
    std::uint32_t other = PointGrid::kNone;  // the vertex that is so near
  };
  // The vertex of another component that is nearest to a place of v's component, which vanishes. Exact where it is
  // farther than `enough2`.
  Lonely nearestOther(std::uint32_t v, const glm::vec3& from, double enough2) {
    // In a grid whose points are mostly gone, empty cells would be searched.
    if (!grid_ || 2 * live_ < grid_triangles_) findComponents();
    const std::uint32_t near = grid_->nearest(
        from, [&](std::uint32_t w) { return component_[w] != component_[v] && isThere(w); },
        static_cast<float>(enough2));
    if (near == PointGrid::kNone) return {std::numeric_limits<float>::max(), near};
    const glm::dvec3 d(positions_[near] - from);
    return {glm::dot(d, d), near};
  }

  void findComponents() {
    ingest::DisjointSets sets(survivor_.size());
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) sets.unite(v, survivor_[v]);
    for (const Triangle& t : triangles_) {
      if (t.alive == 0) continue;
      sets.unite(t.corner[0], t.corner[1]);
      sets.unite(t.corner[0], t.corner[2]);
    }
    component_ = std::move(sets).roots();
    std::vector<std::uint32_t> living;
    for (std::uint32_t v = 0; v < survivor_.size(); ++v)
      if (survivor_[v] == v && isUsed(v)) living.push_back(v);
    grid_.emplace(positions_, living);
    grid_triangles_ = live_;
  }

  // Whether a triangle would turn over or lose its area. Without `strict` only the loss of area counts. A triangle that
  // had no area may do anything.
  bool flips(const glm::vec3& to, bool strict) const {
    return flipsAround(around_.a, around_.around_a, to, strict) || flipsAround(around_.b, around_.around_b, to, strict);
  }
  bool flipsAround(std::uint32_t moved, std::span<const Wedge> wedges, const glm::vec3& to, bool strict) const {
    const glm::vec3 from = positions_[moved];
    if (from == to) return false;
    const PairPoint ends = pairOf(from, to);
    for (const auto& [corner, second, third] : wedges) {
      const PairPoint b = pairOf(positions_[second], positions_[second]) - ends;
      const PairPoint c = pairOf(positions_[third], positions_[third]) - ends;
      const PairPoint n{b.y * c.z - c.y * b.z, b.z * c.x - c.z * b.x, b.x * c.y - c.x * b.y};
      const base::Double2 length2 = dot(n, n);
      const double before2 = length2[0];
      const double after2 = length2[1];
      if (after2 == 0.0 && before2 > 0.0) return true;
      if (!strict || before2 == 0.0) continue;
      const double turn = n.x[0] * n.x[1] + n.y[0] * n.y[1] + n.z[0] * n.z[1];
      if (turn <= 0.0 || turn * turn < kMinTurnCosine * kMinTurnCosine * before2 * after2) return true;
    }
    return false;
  }

  bool isFolded(const Collapse& c) const { return folded_[c.gone] != 0 || folded_[c.kept] != 0; }

  // Whether a triangle on the edge vanishes whose third corner no other triangle around the edge has: nothing takes its
  // place then.
  bool losesThirdCorner(const Collapse& c) const {
    return std::any_of(around_.on_edge.begin(), around_.on_edge.end(), [&](std::uint32_t t) {
      const std::uint32_t third = thirdCorner(t, c);
      return !holds(around_.around_a, third) && !holds(around_.around_b, third);
    });
  }
  std::uint32_t thirdCorner(std::uint32_t t, const Collapse& c) const {
    const auto [one, two] = otherCorners(t, c.gone);
    return one == c.kept ? two : one;
  }
  static bool holds(std::span<const Wedge> wedges, std::uint32_t v) {
    return std::any_of(wedges.begin(), wedges.end(), [&](const Wedge& w) { return w.second == v || w.third == v; });
  }

  // Which of the triangles around the edge stay (remaining_), and which vanish without a replacement (lost_): pairs
  // that come to lie on each other with opposite sides, and triangles on the edge as losesThirdCorner() finds them.
  void findLost(const Collapse& c) {
    remaining_.assign(around_.around_a.begin(), around_.around_a.end());
    remaining_.insert(remaining_.end(), around_.around_b.begin(), around_.around_b.end());
    lost_.clear();
    for (std::size_t i = 0; i < remaining_.size();) {
      const auto isOpposite = [&](const Wedge& w) {
        return w.second == remaining_[i].third && w.third == remaining_[i].second;
      };
      const auto first = remaining_.begin() + static_cast<std::ptrdiff_t>(i);
      const auto other = std::find_if(first + 1, remaining_.end(), isOpposite);
      if (other == remaining_.end()) {
        ++i;
        continue;
      }
      lost_.push_back(first->corner.triangle);
      lost_.push_back(other->corner.triangle);
      remaining_.erase(other);
      remaining_.erase(first);
    }
    for (const std::uint32_t t : around_.on_edge)
      if (!holds(remaining_, thirdCorner(t, c))) lost_.push_back(t);
  }

  // How far the surface moves: the largest distance from the two old places and from lost triangles to what remains.
  // Earlier displacements of the old places are added, so that a needle cannot be shortened step by step for nothing.
  // Distances up to `enough` need not be exact.
  float measureDisplacement(const Collapse& c, double enough) {
    double max_distance = 0.0;
    for (const std::uint32_t v : {c.gone, c.kept})
      if (!remaining_.empty())
        max_distance = std::max(max_distance,
                                static_cast<double>(displacement_[v]) + std::sqrt(distance2ToNewFan(c, positions_[v])));
    double max2 = max_distance * max_distance;
    for (const std::uint32_t t : lost_) {
      const auto& [a, b, d] = triangles_[t].corner;
      if (isAlone(c, t)) {
        max2 = std::max(max2, lonely2(t, std::max(max2, enough * enough)));
        continue;
      }
      for (const auto& [v, w] : {std::pair(a, b), std::pair(b, d), std::pair(d, a)}) {
        // Corners that remain lie on what remains.
        if (!holds(remaining_, v)) max2 = std::max(max2, distance2ToRest(c, t, positions_[v]));
        max2 = std::max(max2, distance2ToRest(c, t, 0.5F * (positions_[v] + positions_[w])));
      }
    }
    return static_cast<float>(std::sqrt(max2));
  }

  // The squared distance from the corners of a lost triangle, that nothing is joined to, to other components. Its three
  // edges ask in turn, so what was found is kept until that other one has vanished as well.
  double lonely2(std::uint32_t t, double enough2) {
    if (lonely_.empty()) lonely_.resize(triangles_.size());
    Lonely& kept = lonely_[t];
    if (kept.distance2 >= 0.0 && (kept.other == PointGrid::kNone || isThere(kept.other))) return kept.distance2;
    kept = {};
    for (const std::uint32_t v : triangles_[t].corner) {
      const Lonely near = nearestOther(v, positions_[v], std::max(kept.distance2, enough2));
      if (near.distance2 > kept.distance2) kept = near;
    }
    return kept.distance2;
  }
  bool isThere(std::uint32_t v) const { return survivor_[v] == v && isUsed(v); }

  // Whether nothing is left that the lost triangle t was joined to.
  bool isAlone(const Collapse& c, std::uint32_t t) const {
    if (!remaining_.empty()) return false;
    const auto& corners = triangles_[t].corner;
    return std::none_of(corners.begin(), corners.end(), [&](std::uint32_t v) {
      if (v == c.gone || v == c.kept) return false;
      const auto fan = cornersAround(v);
      return std::any_of(fan.begin(), fan.end(), [&](const Corner& corner) {
        return triangles_[corner.triangle].alive != 0 && !touches(corner.triangle, c.gone) &&
               !touches(corner.triangle, c.kept);
      });
    });
  }

  // The squared distance from a place of the lost triangle t to the new fan and to the other triangles at its corners;
  // the largest number where nothing is left.
  double distance2ToRest(const Collapse& c, std::uint32_t t, const glm::vec3& from) const {
    double near2 = distance2ToNewFan(c, from);
    for (const std::uint32_t v : triangles_[t].corner) {
      if (v == c.gone || v == c.kept) continue;
      forEachTriangle(v, [&](std::uint32_t s) {
        if (touches(s, c.gone) || touches(s, c.kept)) return;
        const auto& n = triangles_[s].corner;
        near2 = std::min(near2, distance2(from, positions_[n[0]], positions_[n[1]], positions_[n[2]]));
      });
    }
    return near2;
  }

  // The area by which measured distances are weighted, as those from planes are; at least a mean fan's, so that thin
  // spikes and lost triangles count like any other.
  double foldWeight(const Collapse& c) const {
    return std::max(mean_fan_, vertices_[c.gone].quadric.weight + vertices_[c.kept].quadric.weight);
  }
  double foldCost(const Collapse& c) const {
    const double far = c.displacement;
    return std::min(far * far * foldWeight(c), static_cast<double>(std::numeric_limits<float>::max()));
  }

  double distance2ToNewFan(const Collapse& c, const glm::vec3& from) const {
    double near2 = std::numeric_limits<double>::max();
    for (const Wedge& w : remaining_)
      near2 = std::min(near2, distance2(from, c.position, positions_[w.second], positions_[w.third]));
    return near2;
  }
  static double distance2(const glm::vec3& from, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    const glm::dvec3 p(from);
    const glm::dvec3 d = base::closestPointOnTriangle(p, glm::dvec3(a), glm::dvec3(b), glm::dvec3(c)) - p;
    return glm::dot(d, d);
  }

  void applyCollapse(const Collapse& c) {
    moveAttributes(c);
    folded_[c.kept] |= folded_[c.gone];
    displacement_[c.kept] = std::max({displacement_[c.kept], displacement_[c.gone], c.displacement});
    survivor_[c.gone] = c.kept;
    vertices_[c.kept].quadric.add(vertices_[c.gone].quadric);
    vertices_[c.kept].paid = static_cast<float>(vertices_[c.kept].quadric.at(glm::dvec3(c.position)));
    changed_[c.kept] = ++collapses_;
    if (kinds_[c.gone] == VertexKind::kBorder && kinds_[c.kept] == VertexKind::kInterior)
      kinds_[c.kept] = VertexKind::kBorder;
    joinFans(c.gone, c.kept);
  }

  void moveAttributes(const Collapse& c) {
    if (kinds_[c.kept] == VertexKind::kLocked) return;
    QuadricVertex& kept = vertices_[c.kept];
    const QuadricVertex& gone = vertices_[c.gone];
    kept.color = glm::mix(kept.color, gone.color, c.along);
    kept.normal = glm::mix(kept.normal, gone.normal, c.along);
    kept.position = positions_[c.kept] = c.position;
  }

  // The triangles on the edge vanish; the others at `gone` belong to `kept` from now on.
  void joinFans(std::uint32_t gone, std::uint32_t kept) {
    for (const std::uint32_t t : around_.on_edge) triangles_[t].alive = 0;
    live_ -= around_.on_edge.size();
    const bool keeps_a = kept == around_.a;
    const std::span<const Wedge> stay = keeps_a ? around_.around_a : around_.around_b;
    const std::span<const Wedge> move = keeps_a ? around_.around_b : around_.around_a;
    const auto first = static_cast<std::uint32_t>(pool_.size());
    pool_.resize(first + stay.size() + move.size());
    Corner* corner = &pool_[first];
    for (const Wedge& w : stay) *corner++ = w.corner;
    for (const Wedge& w : move) {
      *corner++ = w.corner;
      triangles_[w.corner.triangle].corner[w.corner.place] = kept;
    }
    fans_[kept] = {first, static_cast<std::uint32_t>(pool_.size()) - first};
    fans_[gone] = {};
  }

  // Removes pairs of triangles on the same corners with opposite sides, since they enclose nothing. Only triangles
  // whose other corners were next to both ends (marked by gatherNeighborhood()) can have met a partner. At least one
  // triangle of the group stays.
  void removeOpposites(std::uint32_t v) {
    const auto fan = cornersAround(v);
    for (std::size_t i = 0; i < fan.size(); ++i) {
      Triangle& one = triangles_[fan[i].triangle];
      if (one.alive == 0) continue;
      const Wedge w = wedgeOf(fan[i]);
      if (mark_[w.second] != stamp_ || mark_[w.third] != stamp_) continue;
      for (const Corner& corner : fan.subspan(i + 1)) {
        Triangle& other = triangles_[corner.triangle];
        if (other.alive == 0 || live_ <= 2) continue;
        const Wedge x = wedgeOf(corner);
        if (x.second != w.third || x.third != w.second) continue;
        one.alive = other.alive = 0;
        live_ -= 2;
        break;
      }
    }
  }
  std::pair<std::uint32_t, std::uint32_t> otherCorners(std::uint32_t t, std::uint32_t v) const {
    const auto& c = triangles_[t].corner;
    if (c[0] == v) return {c[1], c[2]};
    return c[1] == v ? std::pair{c[2], c[0]} : std::pair{c[0], c[1]};
  }

  CollapseHistory history(bool rough) {
    CollapseHistory out;
    out.indices.reserve(3 * live_);
    out.origin.reserve(live_);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      if (triangles_[t].alive == 0) continue;
      out.indices.insert(out.indices.end(), triangles_[t].corner.begin(), triangles_[t].corner.end());
      out.origin.push_back(t);
    }
    out.survivor.resize(survivor_.size());
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) out.survivor[v] = find(v);
    out.rough = rough;
    return out;
  }

  // The places of a triangle's corners behind a corner.
  static constexpr std::uint8_t kSecond[3] = {1, 2, 0};
  static constexpr std::uint8_t kThird[3] = {2, 0, 1};
  static constexpr std::uint64_t kNoEnds = ~0ULL;
  // Edges of a bucket lie far from each other: their memory is requested so many edges ahead.
  static constexpr std::size_t kEdgesAhead = 8;

  const GroupMesh& mesh_;
  std::vector<glm::vec3> positions_;  // the same as in vertices_, for code that reads nothing else of a vertex
  const FacetSurface& surface_;       // the mesh as it was given
  std::size_t target_;
  std::size_t live_ = 0;
  std::uint32_t collapses_ = 0;  // so far
  std::vector<Fan> fans_;
  std::vector<Corner> pool_;
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> survivor_;
  std::vector<VertexKind> kinds_;
  std::vector<QuadricVertex> vertices_;
  EdgePlanner planner_{vertices_, kinds_, collapses_};
  std::vector<std::uint32_t> changed_;  // per vertex: its last collapse; apart, since it is read most
  std::vector<PlannedEdge> edges_;
  EdgeQueue queue_;
  std::vector<EdgeQueue::Entry> opened_;
  std::vector<std::uint64_t> known_;
  std::vector<std::uint32_t> mark_;
  std::uint32_t stamp_ = 0;
  Neighborhood around_;
  std::vector<Wedge> remaining_;
  std::vector<std::uint32_t> lost_;
  std::vector<std::uint32_t> component_;  // per vertex; filled with grid_
  std::optional<PointGrid> grid_;
  std::vector<Lonely> lonely_;        // per triangle; empty until one is
  std::size_t grid_triangles_ = 0;    // living triangles when grid_ was filled
  std::vector<std::uint8_t> folded_;  // per vertex
  std::vector<float> displacement_;   // per vertex: how far what it stood for may be from the surface, where folded
  double mean_fan_ = 0.0;             // mean area of the fans of vertices that are not locked
  double mean_edge_ = 1.0;
};

}  // namespace

SimplifiedGroup simplifyGroup(const GroupMesh& mesh, const FacetSurface& surface, std::size_t target_triangles) {
  return Simplifier(mesh, surface, target_triangles).run();
}

}  // namespace lod::patch::builder
