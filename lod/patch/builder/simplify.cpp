#include "lod/patch/builder/simplify.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "base/geometry.h"
#include "lod/patch/builder/point_grid.h"

// Vectors of four doubles go in and out of functions that become part of their caller only: no ABI says how.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace lod::patch::builder {
namespace {

// Perpendicular planes on border edges weigh this much more than a triangle of the same edge length: seams between the
// tiles of a scan must not erode, or they open as gaps.
constexpr double kBorderWeight = 10.0;
// Where the surface is flat every collapse is for nothing, and any order would do: short edges first leave triangles of
// about equal sides. Elsewhere this is nothing: an edge of a thousand steps costs a tenth of a step.
constexpr double kShortFirst = 1e-8;
// Thin strips and beams weigh next to nothing by area, so their ends would slide for nothing: a vertex whose triangles
// cover less than this share of their longest edge's square is tied to its place by this share of a mean edge's square.
constexpr double kThinFan = 0.3;
constexpr double kPointWeight = 5e-3;
// Weighted by area, the tip of a small fan goes far for little, and it is what is off the most in the end: where two
// fans cover less than this many mean ones, costs are divided by the root of their share of it. The mean distance
// hardly minds, as such fans are few.
constexpr double kSmallFans = 2.0;
constexpr double kMinShare = 1e-4;  // of kSmallFans mean fans, so that fans without area cost something finite
// Planes do not say how far a spike sticks out, as those of its sides all hold its axis. Where the vector sum of a
// fan's areas is less than this share of their plain sum, distances are measured.
constexpr double kFolded = 0.6;
// A full change of colour (black to white) counts like a distance of this many mean edges, a normal turned by 60
// degrees like this many.
constexpr double kColorLength = 0.25;
constexpr double kNormalLength = 0.02;
// All but the last stage refuse a collapse that turns a triangle by more than acos of this.
constexpr double kMinTurnCosine = 0.25;
// A vertex placed farther from the edge's middle than this many edge lengths comes from an ill-conditioned system.
constexpr double kMaxPlacementReach = 2.0;

// Squared distances to planes, weighted by area: x^T A x + 2 b x + c (Garland, Heckbert 1997, section 3.3).
struct Quadric {
  double a00 = 0, a01 = 0, a02 = 0, a11 = 0, a12 = 0, a22 = 0;
  double b0 = 0, b1 = 0, b2 = 0, c = 0;
  double weight = 0;

  void addPlane(const glm::dvec3& n, double d, double w) {
    a00 += w * n.x * n.x, a01 += w * n.x * n.y, a02 += w * n.x * n.z;
    a11 += w * n.y * n.y, a12 += w * n.y * n.z, a22 += w * n.z * n.z;
    b0 += w * n.x * d, b1 += w * n.y * d, b2 += w * n.z * d, c += w * d * d;
  }
  void addPoint(const glm::dvec3& p, double w) {
    a00 += w, a11 += w, a22 += w;
    b0 -= w * p.x, b1 -= w * p.y, b2 -= w * p.z, c += w * glm::dot(p, p);
  }
  double at(const glm::dvec3& p) const {
    const double x = a00 * p.x + a01 * p.y + a02 * p.z + 2.0 * b0;
    const double y = a01 * p.x + a11 * p.y + a12 * p.z + 2.0 * b1;
    const double z = a02 * p.x + a12 * p.y + a22 * p.z + 2.0 * b2;
    return std::max(0.0, p.x * x + p.y * y + p.z * z + c);
  }
  void add(const Quadric& q) {
    a00 += q.a00, a01 += q.a01, a02 += q.a02, a11 += q.a11, a12 += q.a12, a22 += q.a22;
    b0 += q.b0, b1 += q.b1, b2 += q.b2, c += q.c, weight += q.weight;
  }
};

// Two or four edges are planned at once, one in each lane; every operation is IEEE's, so that machines agree.
using Pair = double __attribute__((vector_size(16)));
using Four = double __attribute__((vector_size(32)));
template <class Lanes>
using MaskOf = decltype(Lanes{} < Lanes{});
template <class Lanes>
constexpr std::size_t kCount = sizeof(Lanes) / sizeof(double);
// All of it becomes part of its caller, which says for which processors it is.
#define LUMIGRID_LANES inline __attribute__((always_inline))

template <class Lanes>
struct PointLanes {
  Lanes x, y, z;
  LUMIGRID_LANES PointLanes operator-(const PointLanes& p) const { return {x - p.x, y - p.y, z - p.z}; }
};
template <class Lanes>
LUMIGRID_LANES Lanes dot(const PointLanes<Lanes>& p, const PointLanes<Lanes>& q) {
  return p.x * q.x + p.y * q.y + p.z * q.z;
}
template <class Lanes>
LUMIGRID_LANES PointLanes<Lanes> either(const MaskOf<Lanes>& mask, const PointLanes<Lanes>& p,
                                        const PointLanes<Lanes>& q) {
  return {mask ? p.x : q.x, mask ? p.y : q.y, mask ? p.z : q.z};
}
// value(0), value(1), …
template <class Lanes, class Value>
LUMIGRID_LANES Lanes lanesOf(Value&& value) {
  if constexpr (kCount<Lanes> == 2)
    return Lanes{static_cast<double>(value(0)), static_cast<double>(value(1))};
  else
    return Lanes{static_cast<double>(value(0)), static_cast<double>(value(1)), static_cast<double>(value(2)),
                 static_cast<double>(value(3))};
}
template <class Lanes>
LUMIGRID_LANES PointLanes<Lanes> cross(const PointLanes<Lanes>& p, const PointLanes<Lanes>& q) {
  return {p.y * q.z - q.y * p.z, p.z * q.x - q.z * p.x, p.x * q.y - q.x * p.y};
}
using PairPoint = PointLanes<Pair>;
PairPoint pairOf(const glm::vec3& p, const glm::vec3& q) {
  return {Pair{p.x, q.x}, Pair{p.y, q.y}, Pair{p.z, q.z}};
}

// Numbers 2 k and 2 k + 1 of a quadric.
LUMIGRID_LANES Pair twoOf(const Quadric& q, std::size_t k) {
  Pair two;
  std::memcpy(&two, reinterpret_cast<const char*>(&q) + k * sizeof two, sizeof two);
  return two;
}

template <class Lanes>
struct QuadricLanes {
  Lanes a00, a01, a02, a11, a12, a22, b0, b1, b2, c;

  // In each lane the sum of one(lane) and other(lane).
  template <class One, class Other>
  LUMIGRID_LANES QuadricLanes(One&& one, Other&& other) {
    sum(one, other, 0, a00, a01);
    sum(one, other, 1, a02, a11);
    sum(one, other, 2, a12, a22);
    sum(one, other, 3, b0, b1);
    sum(one, other, 4, b2, c);
  }
  LUMIGRID_LANES Lanes at(const PointLanes<Lanes>& p) const {
    const Lanes x = a00 * p.x + a01 * p.y + a02 * p.z + 2.0 * b0;
    const Lanes y = a01 * p.x + a11 * p.y + a12 * p.z + 2.0 * b1;
    const Lanes z = a02 * p.x + a12 * p.y + a22 * p.z + 2.0 * b2;
    const Lanes sum = p.x * x + p.y * y + p.z * z + c;
    return sum > 0.0 ? sum : Lanes{};
  }
  // The point of least error; false where the planes are too parallel to say.
  LUMIGRID_LANES MaskOf<Lanes> minimum(PointLanes<Lanes>& p) const {
    const Lanes m00 = a11 * a22 - a12 * a12;
    const Lanes m01 = a02 * a12 - a01 * a22;
    const Lanes m02 = a01 * a12 - a02 * a11;
    const Lanes determinant = a00 * m00 + a01 * m01 + a02 * m02;
    const Lanes trace = a00 + a11 + a22;
    const Lanes m11 = a00 * a22 - a02 * a02;
    const Lanes m12 = a01 * a02 - a00 * a12;
    const Lanes m22 = a00 * a11 - a01 * a01;
    const Lanes scale = -1.0 / determinant;
    p = {(m00 * b0 + m01 * b1 + m02 * b2) * scale, (m01 * b0 + m11 * b1 + m12 * b2) * scale,
         (m02 * b0 + m12 * b1 + m22 * b2) * scale};
    return determinant > 1e-4 * trace * trace * trace / 27.0;
  }

 private:
  // Numbers 2 k and 2 k + 1 of all.
  template <class One, class Other>
  LUMIGRID_LANES static void sum(const One& one, const Other& other, std::size_t k, Lanes& even, Lanes& odd) {
    const Pair first = twoOf(one(0), k) + twoOf(other(0), k);
    const Pair second = twoOf(one(1), k) + twoOf(other(1), k);
    const Pair low_even = __builtin_shufflevector(first, second, 0, 2);
    const Pair low_odd = __builtin_shufflevector(first, second, 1, 3);
    if constexpr (kCount<Lanes> == 2) {
      even = low_even, odd = low_odd;
    } else {
      const Pair third = twoOf(one(2), k) + twoOf(other(2), k);
      const Pair fourth = twoOf(one(3), k) + twoOf(other(3), k);
      even = __builtin_shufflevector(low_even, __builtin_shufflevector(third, fourth, 0, 2), 0, 1, 2, 3);
      odd = __builtin_shufflevector(low_odd, __builtin_shufflevector(third, fourth, 1, 3), 0, 1, 2, 3);
    }
  }
};

// The quadrics of two planes, as Quadric::addPlane() makes them, with their weights.
class PlanePair {
 public:
  LUMIGRID_LANES PlanePair(const PairPoint& n, const Pair& d, const Pair& weight) {
    const Pair x = weight * n.x;
    const Pair y = weight * n.y;
    const Pair z = weight * n.z;
    const Pair w = weight * d;
    put(0, x * n.x, x * n.y), put(1, x * n.z, y * n.y), put(2, y * n.z, z * n.z);
    put(3, x * d, y * d), put(4, z * d, w * d);
    weight_ = weight;
  }
  LUMIGRID_LANES void addTo(Quadric& q, std::size_t plane) const {
    for (std::size_t k = 0; k < 5; ++k) {
      const Pair two = twoOf(q, k) + values_[plane][k];
      std::memcpy(reinterpret_cast<char*>(&q) + k * sizeof two, &two, sizeof two);
    }
    q.weight += weight_[plane];
  }

 private:
  // Numbers 2 k and 2 k + 1 of both quadrics.
  LUMIGRID_LANES void put(std::size_t k, const Pair& even, const Pair& odd) {
    values_[0][k] = __builtin_shufflevector(even, odd, 0, 2);
    values_[1][k] = __builtin_shufflevector(even, odd, 1, 3);
  }
  Pair values_[2][5];
  Pair weight_;
};

enum class Kind : std::uint8_t { kInterior, kBorder, kLocked };

// Which end of an edge a collapse keeps, by the kinds of a and b. A border edge is one that has other than two
// triangles.
enum class Keep : std::uint8_t { kNone, kA, kB, kBest };
constexpr Keep kKeepOnInnerEdge[3][3] = {
    // b: interior      border       locked
    {Keep::kBest, Keep::kB, Keep::kB},     // a: interior
    {Keep::kA, Keep::kNone, Keep::kNone},  // a: border
    {Keep::kA, Keep::kNone, Keep::kNone},  // a: locked
};
constexpr Keep kKeepOnBorderEdge[3][3] = {
    {Keep::kBest, Keep::kB, Keep::kB},
    {Keep::kA, Keep::kBest, Keep::kB},
    {Keep::kA, Keep::kA, Keep::kNone},
};

// What a stage asks of a collapse, and how far it may move the surface (root mean square, in mean edges) before the
// next stage begins: where the careful way would cost that much, the rough way is the better one.
struct Stage {
  bool keep_topology = true;
  bool keep_orientation = true;
  double largest_move = 0.0;
};
constexpr std::array<Stage, 3> kStages{{{true, true, 0.5}, {false, true, 1.5}, {false, false, 1e30}}};

// An edge and what its collapse would do, as computed when so many collapses had been done.
struct Edge {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  std::uint32_t planned : 31 = 0;
  std::uint32_t keeps_a : 1 = 0;  // or b
  float cost = 0.0F;
  glm::vec3 position{0.0F};
  float along = 0.0F;  // 0 at the kept end, 1 at the gone one: where attributes are taken
};

// All that a plan reads of a vertex, in two cache lines: plans take the vertices in random order.
struct alignas(64) Vertex {
  Quadric quadric;
  glm::vec3 position{0.0F};
  glm::vec3 normal{0.0F};
  glm::vec3 color{0.0F};  // zero when the mesh has none
  float paid = 0.0F;      // the quadric where the vertex is

  // Part of its caller: a call of what does no more than this is taken for one that does nothing.
  __attribute__((always_inline)) void prefetch() const {
    __builtin_prefetch(&quadric);
    __builtin_prefetch(&normal);
  }
};
static_assert(sizeof(Vertex) == 128);

// Edges, cheapest first. None is put in that is cheaper than the last taken out, so only those next in turn need to be
// in order: they lie in a heap of four children to a node. The others wait unordered, by buckets of costs an eighth of
// an octave wide, and most never leave them; a bucket is a chain of blocks. In the heap cost and edge number are one
// 64-bit key (the bits of a float that is not negative sort as it does), so that a comparison is one instruction and
// ties go by number.
class EdgeQueue {
 public:
  struct Entry {
    float cost = 0.0F;
    std::uint32_t edge = 0;
  };
  // Empty, with room for about so many edges.
  void reset(std::size_t edges) {
    keys_.clear();
    open_ = 0;
    newest_.assign(kBuckets, kNone);
    blocks_.clear();
    blocks_.reserve(edges / kBlockEntries + 128);
    free_ = kNone;
  }
  void push(float cost, std::uint32_t edge) {
    const std::uint32_t bucket = bits(cost) >> kBucketShift;
    if (bucket < open_) return pushKey(keyOf(cost, edge));
    std::uint32_t& newest = newest_[bucket];
    if (newest == kNone || blocks_[newest].count == kBlockEntries) newest = blockBefore(newest);
    Block& block = blocks_[newest];
    block.entries[block.count++] = {cost, edge};
  }
  // Hands out the cheapest edges that wait, latest first; they and all as cheap belong in the heap from now on. False
  // if none waits.
  bool open(std::vector<Entry>& entries) {
    entries.clear();
    while (open_ < kBuckets && newest_[open_] == kNone) ++open_;
    if (open_ == kBuckets) return false;
    for (std::uint32_t b = newest_[open_++]; b != kNone;) {
      Block& block = blocks_[b];
      const auto end = std::make_reverse_iterator(block.entries.begin());
      entries.insert(entries.end(), end - block.count, end);
      const std::uint32_t next = std::exchange(block.older, free_);
      free_ = std::exchange(b, next);
    }
    return true;
  }

  // The heap.
  std::size_t size() const { return keys_.size(); }
  float lowest() const { return costOf(keys_.front()); }
  Entry top() const { return {costOf(keys_.front()), static_cast<std::uint32_t>(keys_.front())}; }
  void pop() {
    const std::uint64_t last = keys_.back();
    keys_.pop_back();
    if (!keys_.empty()) sink(0, last);
  }
  // The entry next to the lowest; infinite when there is none.
  Entry second() const {
    if (keys_.size() == 1) return {std::numeric_limits<float>::infinity(), static_cast<std::uint32_t>(keys_.front())};
    const std::uint64_t key =
        *std::min_element(keys_.begin() + 1, keys_.begin() + std::min<std::ptrdiff_t>(5, std::ssize(keys_)));
    return {costOf(key), static_cast<std::uint32_t>(key)};
  }
  // The lowest becomes dearer.
  void raiseTop(float cost) {
    const auto edge = static_cast<std::uint32_t>(keys_.front());
    if (bits(cost) >> kBucketShift < open_) return sink(0, keyOf(cost, edge));
    pop();
    push(cost, edge);
  }

 private:
  static constexpr std::uint32_t kBucketShift = 20;
  static constexpr std::uint32_t kBuckets = 1U << (31 - kBucketShift);
  static constexpr std::uint32_t kNone = ~0U;
  static constexpr std::size_t kBlockEntries = 15;
  struct Block {
    std::uint32_t count = 0;
    std::uint32_t older = kNone;  // block of the bucket; or the next free one
    std::array<Entry, kBlockEntries> entries;
  };

  std::uint32_t blockBefore(std::uint32_t older) {
    std::uint32_t block = free_;
    if (block != kNone) {
      free_ = blocks_[block].older;
    } else {
      block = static_cast<std::uint32_t>(blocks_.size());
      blocks_.emplace_back();
    }
    blocks_[block].count = 0;
    blocks_[block].older = older;
    return block;
  }
  static std::uint32_t bits(float cost) { return std::bit_cast<std::uint32_t>(std::max(0.0F, cost)); }
  static std::uint64_t keyOf(float cost, std::uint32_t edge) { return std::uint64_t{bits(cost)} << 32 | edge; }
  static float costOf(std::uint64_t key) { return std::bit_cast<float>(static_cast<std::uint32_t>(key >> 32)); }
  void pushKey(std::uint64_t key) {
    std::size_t i = keys_.size();
    keys_.push_back(key);
    for (; i > 0 && key < keys_[(i - 1) / 4]; i = (i - 1) / 4) keys_[i] = keys_[(i - 1) / 4];
    keys_[i] = key;
  }
  void sink(std::size_t i, std::uint64_t key) {
    const std::size_t size = keys_.size();
    for (std::size_t child = 4 * i + 1; child < size; child = 4 * i + 1) {
      const std::size_t end = std::min(child + 4, size);
      std::size_t least = child;
      std::uint64_t least_key = keys_[child];
      for (std::size_t c = child + 1; c < end; ++c) {
        const bool less = keys_[c] < least_key;
        least = less ? c : least;
        least_key = less ? keys_[c] : least_key;
      }
      if (key <= least_key) break;
      keys_[i] = least_key;
      i = least;
    }
    keys_[i] = key;
  }

  std::vector<std::uint64_t> keys_;
  std::uint32_t open_ = 0;             // buckets below are empty
  std::vector<std::uint32_t> newest_;  // per bucket: its block that is not full
  std::vector<Block> blocks_;
  std::uint32_t free_ = kNone;
};

// What a collapse of edge (a, b) would do: a goes, b stays.
struct Collapse {
  std::uint32_t gone = 0;
  std::uint32_t kept = 0;
  glm::vec3 position{0.0F};
  float along = 0.0F;  // 0 at kept, 1 at gone: where attributes are taken
  float sunk = 0.0F;   // how far the surface leaves what it stood for; measured where it is folded or lost
};

// To the nearest lattice point, halves up, and what misses a half by less than such systems err. Adding and taking away
// a number so large leaves no room for fractions; that rounds halves to even, put right where it went up too far.
template <class Lanes>
LUMIGRID_LANES Lanes rounded(const Lanes& value) {
  constexpr double kAbove = 1 << 24;  // no coordinate is larger; sums with it keep 28 bits of fraction
  constexpr double kNoFractions = 3.0 * (1LL << 51);
  const Lanes raised = value + (kAbove + 0.5);
  const Lanes near = (raised + kNoFractions) - kNoFractions;
  return (near > raised ? near - 1.0 : near) - kAbove;
}

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

    // Each stage again while edges refused earlier become possible; then the next.
    std::size_t stage = 0;
    for (;;) {
      const std::size_t before = live_;
      collapseAll(kStages[stage]);
      if (live_ <= target_) break;
      const bool last = stage + 1 == kStages.size();
      if (last && live_ == before) break;
      if (!last && before - live_ < std::max<std::size_t>(1, before / 50)) ++stage;
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

  // Triangles around each vertex, as ranges of one pool; a collapse appends the joined fan at its end.
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

  // Every edge once, and what its number of triangles says about its ends.
  void findEdges() {
    const std::size_t vertices = positions_.size();
    kinds_.assign(vertices, Kind::kInterior);
    vertices_.assign(vertices, {});
    for (std::uint32_t v = 0; v < vertices; ++v) {
      if (mesh_.locked[v] != 0) kinds_[v] = Kind::kLocked;
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
    color_scale_ = kColorLength * mean / 255.0;
    normal_scale_ = kNormalLength * mean;
  }

  // The vertices above v that share a triangle with it, each once.
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

  // Of triangles that live or did.
  std::span<const Corner> cornersAround(std::uint32_t v) const {
    return {pool_.data() + fans_[v].first, fans_[v].count};
  }

  template <class Body>
  void forEachTriangle(std::uint32_t v, Body&& body) const {
    for (const Corner& c : cornersAround(v))
      if (triangles_[c.triangle].alive != 0) body(c.triangle);
  }

  // By a triangle that lives.
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
      if (kinds_[end] == Kind::kInterior) kinds_[end] = Kind::kBorder;
    forEachTriangle(v, [&](std::uint32_t t) {
      if (touches(t, w)) addBorderQuadric(v, w, t);
    });
  }

  // The plane through the edge, perpendicular to the triangle: what keeps a border where it is.
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

  // What the triangles around a vertex say together.
  struct FanShape {
    glm::dvec3 vector_area{0.0};
    double longest2 = 0.0;  // edge
  };

  void addTriangleQuadrics() {
    std::vector<FanShape> shapes(vertices_.size());
    // Two triangles at once, added one after the other.
    for (std::size_t t = 0; t < triangles_.size(); t += 2) {
      const std::array<const Triangle*, 2> two{&triangles_[t], &triangles_[std::min(t + 1, triangles_.size() - 1)]};
      const auto place = [&](std::size_t k) {
        return pairOf(positions_[two[0]->corner[k]], positions_[two[1]->corner[k]]);
      };
      const PairPoint p = place(0);
      const PairPoint q = place(1);
      const PairPoint r = place(2);
      const std::array<PairPoint, 3> edges{q - p, r - q, p - r};
      const std::array<Pair, 3> length2{dot(edges[0], edges[0]), dot(edges[1], edges[1]), dot(edges[2], edges[2])};
      PairPoint n = cross(edges[2], edges[0]);
      const Pair length2_of_n = dot(n, n);
      const Pair length{std::sqrt(length2_of_n[0]), std::sqrt(length2_of_n[1])};
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
    sunk_.assign(vertices_.size(), 0.0F);
    double sum = 0.0;
    std::size_t free = 0;
    for (std::size_t v = 0; v < vertices_.size(); ++v) {
      const double area = vertices_[v].quadric.weight;
      folded_[v] = glm::length(shapes[v].vector_area) < kFolded * area ? 1 : 0;
      if (kinds_[v] != Kind::kLocked) sum += area, ++free;
    }
    mean_fan_ = sum / static_cast<double>(std::max<std::size_t>(1, free));
    small_fans_ = mean_fan_ > 0.0 ? kSmallFans * mean_fan_ : 1.0;
  }

  void tieThinFans(const std::vector<FanShape>& shapes) {
    for (std::size_t v = 0; v < vertices_.size(); ++v)
      if (vertices_[v].quadric.weight < kThinFan * shapes[v].longest2)
        vertices_[v].quadric.addPoint(glm::dvec3(positions_[v]), kPointWeight * mean_edge_ * mean_edge_);
  }

  void queueEdges() {
    queue_.reset(edges_.size());
    constexpr std::size_t kRun = 512;  // of edges, that are in the nearest cache still when they are pushed
    for (std::size_t first = 0; first < edges_.size(); first += kRun) {
      const std::span<Edge> run = std::span(edges_).subspan(first, std::min(kRun, edges_.size() - first));
      planAll(run.size(), [&](std::size_t i) -> Edge& { return run[i]; });
      for (std::size_t i = 0; i < run.size(); ++i) queue_.push(run[i].cost, static_cast<std::uint32_t>(first + i));
    }
  }

  // All edges of the triangles that live.
  void refillQueue() {
    grid_.reset();  // many of its vertices are gone
    edges_.clear();
    std::vector<std::uint32_t> neighbors;
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) {
      if (survivor_[v] != v) continue;
      neighborsAbove(v, neighbors);
      for (const std::uint32_t w : neighbors)
        if (kinds_[v] != Kind::kLocked || kinds_[w] != Kind::kLocked) edges_.push_back({.a = v, .b = w});
    }
    queueEdges();
  }

  // Cheapest first. Quadrics only grow, so that costs seldom fall: a cost is computed anew when its turn comes, and the
  // edge waits again if it has become dearer.
  void collapseAll(const Stage& stage) {
    const double most = stage.largest_move * stage.largest_move * mean_edge_ * mean_edge_ * mean_edge_ * mean_edge_;
    while (live_ > target_ && fillQueue() && queue_.lowest() <= most) {
      const EdgeQueue::Entry entry = queue_.top();
      Edge& edge = edges_[entry.edge];
      findEnds(edge);
      if (edge.a == edge.b) {
        queue_.pop();
        continue;
      }
      const EdgeQueue::Entry next = queue_.second();
      // Fans lie anywhere in memory: of this edge the triangles are asked for before they are looked at, of the next
      // one which they are.
      for (const std::uint32_t v : {edge.a, edge.b}) {
        vertices_[v].prefetch();
        for (const Corner& c : cornersAround(v)) __builtin_prefetch(&triangles_[c.triangle]);
      }
      for (const std::uint32_t v : {edges_[next.edge].a, edges_[next.edge].b})
        __builtin_prefetch(cornersAround(v).data());
      if (isStale(edge)) {
        Edge& other = edges_[next.edge];
        findEnds(other);
        plan(edge, isStale(other) ? other : edge);
      }
      if (edge.cost > entry.cost && edge.cost > next.cost) {
        queue_.raiseTop(edge.cost);
        continue;
      }
      queue_.pop();
      lookAt(edge.a, edge.b);
      const std::size_t triangles = around_.on_edge.size();
      if (triangles == 0) continue;
      if (keepOf(edge.a, edge.b, triangles != 2 || !stage.keep_topology) == Keep::kNone) continue;
      if (stage.keep_topology && around_.common != triangles) continue;
      Collapse collapse{edge.keeps_a != 0 ? edge.b : edge.a, edge.keeps_a != 0 ? edge.a : edge.b, edge.position,
                        edge.along};
      if (flips(collapse.position, stage.keep_orientation)) continue;
      if (live_ <= triangles) continue;
      const bool meets = countBetween(around_.around_a) + countBetween(around_.around_b) >= 2;
      if (isFolded(collapse) || meets || losesThirdCorner(collapse)) {
        findLost(collapse);
        collapse.sunk = sinking(collapse, std::sqrt(static_cast<double>(entry.cost) / foldWeight(collapse)));
        if (waits(entry, static_cast<float>(foldCost(collapse)))) continue;
      }
      apply(collapse);
      if (meets) removeOpposites(collapse.kept);
    }
  }

  SimplifiedGroup result(bool rough) {
    GroupMesh vertices{std::move(positions_), {}, {}, {}, {}};
    vertices.normals.reserve(vertices_.size());
    for (const Vertex& v : vertices_) vertices.normals.push_back(v.normal);
    if (!mesh_.colors.empty()) {
      vertices.colors.reserve(vertices_.size());
      for (const Vertex& v : vertices_) vertices.colors.push_back(v.color);
    }
    return {std::move(vertices), history(rough)};
  }

  // At least two edges in the queue's heap if there are as many; false if there is none at all. Edges that waited are
  // planned anew before they get there, which sends many of them back.
  bool fillQueue() {
    while (queue_.size() < 2 && queue_.open(opened_)) {
      std::size_t stale = 0;
      forgetEdges(opened_.size());
      for (std::size_t i = 0; i < opened_.size(); ++i) {
        __builtin_prefetch(&edges_[opened_[std::min(i + kEdgesAhead, opened_.size() - 1)].edge]);
        const EdgeQueue::Entry entry = opened_[i];
        Edge& edge = edges_[entry.edge];
        findEnds(edge);
        if (edge.a == edge.b) continue;
        const bool moved = (changed_[edge.a] | changed_[edge.b]) != 0;
        if (moved && isKnown(edge)) continue;
        if (isStale(edge)) {
          opened_[stale++] = entry;
          for (const std::uint32_t v : {edge.a, edge.b}) vertices_[v].prefetch();
        } else {
          queue_.push(entry.cost, entry.edge);
        }
      }
      opened_.resize(stale);
      planAll(stale, [&](std::size_t i) -> Edge& { return edges_[opened_[i].edge]; });
      for (const EdgeQueue::Entry& entry : opened_)
        queue_.push(std::max(entry.cost, edges_[entry.edge].cost), entry.edge);
    }
    return queue_.size() != 0;
  }

  // A hash table of the edges seen since, by their ends: collapses lay edges on each other.
  void forgetEdges(std::size_t expected) { known_.assign(std::bit_ceil(2 * expected), kNoEnds); }
  bool isKnown(const Edge& edge) {
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

  void findEnds(Edge& edge) {
    edge.a = find(edge.a);
    edge.b = find(edge.b);
  }
  bool isStale(const Edge& edge) const { return std::max(changed_[edge.a], changed_[edge.b]) > edge.planned; }

  // Puts an edge back that has become dearer than it was and than the next.
  bool waits(const EdgeQueue::Entry& entry, float cost) {
    if (queue_.size() == 0 || cost <= entry.cost || cost <= queue_.lowest()) return false;
    queue_.push(cost, entry.edge);
    return true;
  }

  std::uint32_t find(std::uint32_t v) {
    while (survivor_[v] != v) v = survivor_[v] = survivor_[survivor_[v]];
    return v;
  }

  // A living triangle around a vertex, and its corners after it.
  struct Wedge {
    Corner corner;
    std::uint32_t second = 0;
    std::uint32_t third = 0;
  };
  // The triangles around an edge, as lookAt finds them. A fan's compactness is lost with every collapse beside it, so
  // it is read but once.
  struct Neighborhood {
    std::uint32_t a = 0;
    std::uint32_t b = 0;
    std::span<const Wedge> around_a, around_b;  // without those on the edge
    std::span<const std::uint32_t> on_edge;     // triangles
    std::uint32_t common = 0;                   // vertices next to both ends
    std::vector<Wedge> wedges_a, wedges_b;      // where these lie
    std::vector<std::uint32_t> triangles;
  };

  // Fills around_; leaves mark_ == stamp_ on the vertices next to both ends. Which triangles live is a matter of
  // chance: all are written, and the next one over those that do not count.
  void lookAt(std::uint32_t a, std::uint32_t b) {
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

  // How many of these triangles lie between vertices that were next to both ends, after lookAt.
  std::uint32_t countBetween(std::span<const Wedge> wedges) const {
    std::uint32_t between = 0;
    for (const Wedge& w : wedges) between += mark_[w.second] == stamp_ && mark_[w.third] == stamp_ ? 1 : 0;
    return between;
  }

  // From a place of a component that vanishes to what stays: the nearest vertex of another component tells. Squared,
  // exact where it is more than `enough2`.
  double distance2ToOthers(std::uint32_t v, const glm::vec3& from, double enough2) {
    // Of a grid whose points are mostly gone, empty cells would be searched.
    if (!grid_ || 2 * live_ < grid_triangles_) findComponents();
    const std::uint32_t near = grid_->nearest(
        from, [&](std::uint32_t w) { return component_[w] != component_[v] && survivor_[w] == w && isUsed(w); },
        static_cast<float>(enough2));
    if (near == PointGrid::kNone) return std::numeric_limits<float>::max();
    const glm::dvec3 d(positions_[near] - from);
    return glm::dot(d, d);
  }

  void findComponents() {
    component_.resize(survivor_.size());
    std::iota(component_.begin(), component_.end(), 0U);
    auto root = [&](std::uint32_t v) {
      while (component_[v] != v) v = component_[v] = component_[component_[v]];
      return v;
    };
    auto join = [&](std::uint32_t v, std::uint32_t w) { component_[root(v)] = root(w); };
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) join(v, survivor_[v]);
    for (const Triangle& t : triangles_) {
      if (t.alive == 0) continue;
      join(t.corner[0], t.corner[1]);
      join(t.corner[0], t.corner[2]);
    }
    std::vector<std::uint32_t> living;
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) {
      component_[v] = root(v);
      if (survivor_[v] == v && isUsed(v)) living.push_back(v);
    }
    grid_.emplace(positions_, living);
    grid_triangles_ = live_;
  }

  Keep keepOf(std::uint32_t a, std::uint32_t b, bool border_edge) const {
    const auto row = static_cast<std::size_t>(kinds_[a]);
    const auto column = static_cast<std::size_t>(kinds_[b]);
    return border_edge ? kKeepOnBorderEdge[row][column] : kKeepOnInnerEdge[row][column];
  }

  // plan of edge(0) … edge(count - 1).
  template <class EdgeAt>
  void planAll(std::size_t count, EdgeAt&& edge) const {
    std::size_t i = 0;
#if defined(__x86_64__)
    static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
    for (; has_avx2 && i + 4 <= count; i += 4) planFour(edge(i), edge(i + 1), edge(i + 2), edge(i + 3));
#endif
    for (; i < count; i += 2) plan(edge(i), edge(std::min(i + 1, count - 1)));
  }
  // Two edges, or one twice.
  void plan(Edge& first, Edge& second) const {
    planLanes<Pair>({&first, &second});
  }
#if defined(__x86_64__)
  __attribute__((target("avx2"))) void planFour(Edge& first, Edge& second, Edge& third, Edge& fourth) const {
    planLanes<Four>({&first, &second, &third, &fourth});
  }
#endif

  // Which end stays, where, and at what cost. Without knowing an edge's triangles: the kinds decide as on a border
  // edge. What is the better choice is a matter of chance, so that none is a branch.
  template <class Lanes>
  LUMIGRID_LANES void planLanes(const std::array<Edge*, kCount<Lanes>>& edges) const {
    constexpr std::size_t kLanes = kCount<Lanes>;
    MaskOf<Lanes> free{};
    std::array<const Vertex*, kLanes> kept_end;
    std::array<const Vertex*, kLanes> gone_end;
    for (std::size_t i = 0; i < kLanes; ++i) {
      Edge& edge = *edges[i];
      const Keep keep = keepOf(edge.a, edge.b, true);
      edge.keeps_a = keep == Keep::kA ? 1 : 0;
      free[i] = keep == Keep::kBest ? -1 : 0;
      kept_end[i] = &vertices_[keep == Keep::kA ? edge.a : edge.b];
      gone_end[i] = &vertices_[keep == Keep::kA ? edge.b : edge.a];
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

    // The point of least error, on the lattice; the middle where there is none.
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

    // Of these three the cheapest, and what that adds to what both ends are off already: so the sum over all is lowered
    // greedily, and places that are off once do not keep good collapses beside them waiting. The kept end when it must
    // not move.
    const Lanes one = Lanes{} + 1.0;
    const MaskOf<Lanes> takes_best = free & (at_best < at_kept) & (at_best < at_gone);
    const MaskOf<Lanes> takes_gone = free & (at_gone < at_kept);
    const Lanes least = takes_best ? at_best : takes_gone ? at_gone : at_kept;
    const PointLanes<Lanes> place = either<Lanes>(takes_best, lattice, either<Lanes>(takes_gone, gone, kept));
    const Lanes share = along > one ? one : along > 0.0 ? along : Lanes{};
    const Lanes taken_at = takes_best ? share : takes_gone ? one : Lanes{};
    const Lanes paid = lanesOf<Lanes>([&](std::size_t i) { return kept_end[i]->paid; }) +
                       lanesOf<Lanes>([&](std::size_t i) { return gone_end[i]->paid; });
    const Lanes added = least > paid ? least - paid : Lanes{};

    // Colours and normals that differ make an edge dearer, by the smaller of the areas that would change.
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
      Edge& edge = *edges[i];
      edge.planned = collapses_ & 0x7fffffffU;
      edge.cost = static_cast<float>(cost[i]);
      edge.position = {static_cast<float>(place.x[i]), static_cast<float>(place.y[i]), static_cast<float>(place.z[i])};
      edge.along = static_cast<float>(taken_at[i]);
    }
  }

  // Would a triangle turn over or lose its area? The last stage minds only the loss of area, which says nothing about a
  // triangle that had none.
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
      const Pair length2 = dot(n, n);
      const double before2 = length2[0];
      const double after2 = length2[1];
      if (after2 == 0.0 && before2 > 0.0) return true;
      if (!strict || before2 == 0.0) continue;
      const double turn = n.x[0] * n.x[1] + n.y[0] * n.y[1] + n.z[0] * n.z[1];
      if (turn <= 0.0 || turn * turn < kMinTurnCosine * kMinTurnCosine * before2 * after2) return true;
    }
    return false;
  }

  bool isFolded(const Collapse& c) const {
    return folded_[c.gone] != 0 || folded_[c.kept] != 0;
  }

  // Does a triangle on the edge go that nothing takes the place of, as no other holds its third corner? The others so
  // lost are two that come to lie on each other with opposite sides.
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

  // Which of the triangles around the edge stay (left_), and which are lost so (lost_).
  void findLost(const Collapse& c) {
    left_.assign(around_.around_a.begin(), around_.around_a.end());
    left_.insert(left_.end(), around_.around_b.begin(), around_.around_b.end());
    lost_.clear();
    for (std::size_t i = 0; i < left_.size();) {
      const auto isOpposite = [&](const Wedge& w) { return w.second == left_[i].third && w.third == left_[i].second; };
      const auto first = left_.begin() + static_cast<std::ptrdiff_t>(i);
      const auto other = std::find_if(first + 1, left_.end(), isOpposite);
      if (other == left_.end()) {
        ++i;
        continue;
      }
      lost_.push_back(first->corner.triangle);
      lost_.push_back(other->corner.triangle);
      left_.erase(other);
      left_.erase(first);
    }
    for (const std::uint32_t t : around_.on_edge)
      if (!holds(left_, thirdCorner(t, c))) lost_.push_back(t);
  }

  // How far the two old places, on top of what they had sunk (a needle must not go down in steps), and what is lost are
  // from what stays. What is no farther than `enough` need not be exact.
  float sinking(const Collapse& c, double enough) {
    double most = 0.0;
    for (const std::uint32_t v : {c.gone, c.kept})
      if (!left_.empty())
        most = std::max(most, static_cast<double>(sunk_[v]) + std::sqrt(distance2ToNewFan(c, positions_[v])));
    double most2 = most * most;
    for (const std::uint32_t t : lost_)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = triangles_[t].corner[k];
        const std::uint32_t w = triangles_[t].corner[(k + 1) % 3];
        const glm::vec3& p = positions_[v];
        const double near2 = distance2ToRest(c, t, p);
        if (near2 == std::numeric_limits<double>::max()) {
          most2 = std::max(most2, distance2ToOthers(v, p, std::max(most2, enough * enough)));
          continue;
        }
        most2 = std::max({most2, near2, distance2ToRest(c, t, 0.5F * (p + positions_[w]))});
      }
    return static_cast<float>(std::sqrt(most2));
  }

  // From a place of triangle t, which is lost, to the new fan and what else hangs on its corners. Squared; the largest
  // number where nothing is left.
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

  // Weighted as distances from planes are; but a thin spike, and what is lost, counts like any other.
  double foldWeight(const Collapse& c) const {
    return std::max(mean_fan_, vertices_[c.gone].quadric.weight + vertices_[c.kept].quadric.weight);
  }
  double foldCost(const Collapse& c) const {
    const double far = c.sunk;
    return std::min(far * far * foldWeight(c), static_cast<double>(std::numeric_limits<float>::max()));
  }

  double distance2ToNewFan(const Collapse& c, const glm::vec3& from) const {
    double near2 = std::numeric_limits<double>::max();
    for (const Wedge& w : left_)
      near2 = std::min(near2, distance2(from, c.position, positions_[w.second], positions_[w.third]));
    return near2;
  }
  static double distance2(const glm::vec3& from, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    const glm::dvec3 p(from);
    const glm::dvec3 d = base::closestPointOnTriangle(p, glm::dvec3(a), glm::dvec3(b), glm::dvec3(c)) - p;
    return glm::dot(d, d);
  }

  void apply(const Collapse& c) {
    moveAttributes(c);
    folded_[c.kept] |= folded_[c.gone];
    sunk_[c.kept] = std::max({sunk_[c.kept], sunk_[c.gone], c.sunk});
    survivor_[c.gone] = c.kept;
    vertices_[c.kept].quadric.add(vertices_[c.gone].quadric);
    vertices_[c.kept].paid = static_cast<float>(vertices_[c.kept].quadric.at(glm::dvec3(c.position)));
    changed_[c.kept] = ++collapses_;
    if (kinds_[c.gone] == Kind::kBorder && kinds_[c.kept] == Kind::kInterior) kinds_[c.kept] = Kind::kBorder;
    joinFans(c.gone, c.kept);
  }

  void moveAttributes(const Collapse& c) {
    if (kinds_[c.kept] == Kind::kLocked) return;
    Vertex& kept = vertices_[c.kept];
    const Vertex& gone = vertices_[c.gone];
    kept.color = glm::mix(kept.color, gone.color, c.along);
    kept.normal = glm::mix(kept.normal, gone.normal, c.along);
    kept.position = positions_[c.kept] = c.position;
  }

  // Triangles on the edge vanish, the others of `gone` hang on `kept` from now on.
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

  // Two triangles on the same corners with opposite sides enclose nothing: both go. Only triangles whose other corners
  // were next to both ends (marked by lookAt) can have met a partner. At least one triangle of the group stays.
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

  Simplified history(bool rough) {
    Simplified out;
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

  // The corners after one, in a triangle.
  static constexpr std::uint8_t kSecond[3] = {1, 2, 0};
  static constexpr std::uint8_t kThird[3] = {2, 0, 1};
  static constexpr std::uint64_t kNoEnds = ~0ULL;
  // Edges wait in memory far from each other: how many ahead their own data is asked for.
  static constexpr std::size_t kEdgesAhead = 8;

  const GroupMesh& mesh_;
  std::vector<glm::vec3> positions_;  // as in vertices_, for what asks for nothing else
  const FacetSurface& surface_;       // of the mesh as it was given
  std::size_t target_;
  std::size_t live_ = 0;
  std::uint32_t collapses_ = 0;  // done so far
  std::vector<Fan> fans_;
  std::vector<Corner> pool_;
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> survivor_;
  std::vector<Kind> kinds_;
  std::vector<Vertex> vertices_;
  std::vector<std::uint32_t> changed_;  // per vertex: by which collapse; apart, as queues ask for it most
  std::vector<Edge> edges_;
  EdgeQueue queue_;
  std::vector<EdgeQueue::Entry> opened_;
  std::vector<std::uint64_t> known_;
  std::vector<std::uint32_t> mark_;
  std::uint32_t stamp_ = 0;
  Neighborhood around_;
  std::vector<Wedge> left_;  // as findLost finds them
  std::vector<std::uint32_t> lost_;
  std::vector<std::uint32_t> component_;  // per vertex; made when first asked for
  std::optional<PointGrid> grid_;
  std::size_t grid_triangles_ = 0;    // that lived when it was made
  std::vector<std::uint8_t> folded_;  // per vertex
  std::vector<float> sunk_;           // per vertex: how far what it stands for may be from the surface, where folded
  double mean_fan_ = 0.0;             // area, of vertices that are not locked
  double small_fans_ = 1.0;           // area of two
  double mean_edge_ = 1.0;
  double color_scale_ = 0.0;
  double normal_scale_ = 0.0;
};

}  // namespace

SimplifiedGroup simplifyGroup(const GroupMesh& mesh, const FacetSurface& surface, std::size_t target_triangles) {
  return Simplifier(mesh, surface, target_triangles).run();
}

Simplified simplifyGroup(GroupMesh& mesh, std::size_t target_triangles) {
  FacetSurface surface;
  surface.reset({mesh.positions, mesh.indices});
  SimplifiedGroup made = simplifyGroup(mesh, surface, target_triangles);
  mesh.positions = std::move(made.vertices.positions);
  mesh.normals = std::move(made.vertices.normals);
  mesh.colors = std::move(made.vertices.colors);
  return std::move(made.simplified);
}

}  // namespace lod::patch::builder
