#include "lod/hlod/builder/collapse.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <unordered_map>
#include <utility>

#include "base/simd.h"
#include "lod/hlod/builder/vertex_queue.h"
#include "lod/patch/builder/facet_surface.h"

namespace lod::hlod::builder {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
// Vertices with more triangles around them are left alone: looking at all of them for each neighbour would take long.
constexpr std::size_t kMaxStar = 64;
// So many targets of a vertex are tried, the cheapest first. A choice: the third succeeds seldom.
constexpr std::size_t kTries = 2;
// A collapse may turn a triangle by at most 84 degrees.
constexpr float kLeastCosine = 0.1F;
// Short collapses come first among those that move the surface equally little.
constexpr float kLengthCost = 0.1F;
constexpr float kTurnCost = 0.5F;
// Edges so many times as long as the limit show what lies between their ends.
constexpr float kLongEdge = 4.0F;
constexpr float kColorCost = 1.0F / 128.0F;
// A vertex waits again where its collapse has become dearer than when it was queued by about so much: half an octave,
// a factor of 1.4. With a whole one there are 0.5 % more triangles, and it is no faster.
constexpr std::uint32_t kStaleRanks = VertexQueue::kRanksPerOctave / 2;

/// The four vectors lane by lane.
LUMIGRID_ALWAYS_INLINE FourPoints side(const Four& a, const Four& b, const Four& c, const Four& d) {
  const std::array<Four, 4> rows{a, b, c, d};
  const std::array<Four, 4> lanes = base::transposed(rows.data());
  return {lanes[0], lanes[1], lanes[2]};
}
LUMIGRID_ALWAYS_INLINE float lowestOf(const Four& v) {
  return std::min(std::min(v[0], v[1]), std::min(v[2], v[3]));
}

/// A list of at most kMost items, which is refilled all the time: no call of it allocates.
template <class Item, std::size_t kMost>
class ShortList {
 public:
  void clear() { size_ = 0; }
  void push_back(const Item& item) { items_[size_++] = item; }
  /// One more item, of which nothing is known yet. A whole one that was just put together would be copied by loads that
  /// are wider than the stores before, and processors wait for those.
  Item& add() { return items_[size_++]; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  Item& operator[](std::size_t i) { return items_[i]; }
  const Item& operator[](std::size_t i) const { return items_[i]; }
  Item* begin() { return items_; }
  Item* end() { return items_ + size_; }
  const Item* begin() const { return items_; }
  const Item* end() const { return items_ + size_; }

 private:
  Item items_[kMost];
  std::size_t size_ = 0;
};

class Collapser {
 public:
  Collapser(const NodeMesh& mesh, float limit, const AppearanceOptions& options, Carried carried)
      : limit_(limit), options_(options), queue_(mesh.positions.size()) {
    const std::size_t triangles = mesh.triangles();
    addVertices(mesh);
    triangles_.resize(triangles);
    const bool is_bounded = carried == Carried::kBounds && !mesh.bounds.toward.empty();
    const bool has_errors = carried == Carried::kErrors && (mesh.error > 0.0F || !mesh.errors.empty());
    for (std::uint32_t t = 0; t < triangles; ++t) {
      Triangle& triangle = triangles_[t];
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t v = triangle.corner[k] = mesh.indices[3 * std::size_t{t} + k];
        ++vertices_[v].corners;
        if (!is_bounded && !has_errors) continue;
        const float room = std::max(limit - (is_bounded ? mesh.bounds.toward[t] : mesh.errorOf(t)), 0.0F);
        vertices_[v].room2 = std::min(vertices_[v].room2, room * room);
      }
      triangle.reach = is_bounded ? mesh.bounds.from[t] : has_errors ? mesh.errorOf(t) : 0.0F;
      triangle.direction = directionOf(triangle);
    }
    linkCorners();
  }

#if defined(__x86_64__)
  /// The same with the instructions of processors that have AVX2: everything becomes a part of this function.
  [[gnu::flatten]] __attribute__((target("avx2"))) Collapsed runByAvx2() {
    return run();
  }
#endif

  Collapsed run() {
    for (std::uint32_t v = 0; v < vertices_.size(); ++v) push(v);
    while (true) {
      const VertexQueue::Entry top = queue_.pop();
      if (top.vertex == kNone) break;
      findTargets(top.vertex);
      if (targets_[0].slot == kNone) continue;
      // The vertex' surroundings may have changed since it was queued.
      if (VertexQueue::rankOf(targets_[0].cost) > top.rank + kStaleRanks)
        queue_.push(top.vertex, targets_[0].cost);
      else
        tryVertex(top.vertex);
    }
    return finish();
  }

 private:
  // All that is known of a vertex lies together, as do the corners of a triangle: the queue jumps to and fro.
  struct alignas(64) Vertex {
    Attributes at;
    float room2 = 0.0F;  // the square of what it may be off
    // In corners_. A vertex that went has none: its first_corner is the square of its error as a sample, as bits.
    std::uint32_t first_corner = 0, corners = 0;
    std::uint32_t next_sample = kNone;
  };
  static_assert(sizeof(Vertex) == 64);
  struct Triangle {
    std::array<std::uint32_t, 3> corner{};  // all kNone where the triangle is gone
    glm::vec3 direction{0.0F};              // the unit normal, or zero
    float reach = 0.0F;  // about how far the triangle's places are from the source, as far as that counts
    std::uint32_t first_sample = kNone;
  };
  // A triangle at the vertex that is looked at, and where its other corners are in the list of neighbours.
  struct Spoke {
    std::uint32_t triangle;
    std::uint32_t next, last;  // in the triangle's winding, from the vertex on
  };
  struct Neighbor {
    std::uint32_t vertex;
    std::uint32_t triangles;  // at the edge
    bool is_common;           // of the vertex and the one that it might be collapsed into
    float reach;              // of the edge that a collapse would make
  };
  struct Mark {
    std::uint32_t stamp = 0, slot = 0;
  };
  // A vertex has at most two neighbours for each triangle around it.
  static constexpr std::size_t kMaxNeighbors = 2 * kMaxStar;
  struct Target {
    std::uint32_t slot = kNone;  // of a neighbour
    float cost = std::numeric_limits<float>::infinity();
  };
  struct Placed {
    std::uint32_t sample = 0, triangle = 0;
    float error2 = 0.0F;
  };

  static std::uint32_t cornerNumber(std::uint32_t t, std::uint32_t k) {
    return 4 * t + k;
  }

  void addVertices(const NodeMesh& mesh) {
    vertices_.resize(mesh.positions.size());
    marks_.resize(mesh.positions.size());
    survivor_.resize(mesh.positions.size());
    for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
      Vertex& vertex = vertices_[v];
      vertex.at = {fourOf(mesh.positions[v]), fourOf(mesh.normals[v]),
                   mesh.colors.empty() ? Four{} : fourOf(mesh.colors[v])};
      vertex.room2 = limit_ * limit_;
      survivor_[v] = v;
    }
  }

  const Four& positionOf(std::uint32_t v) const {
    return vertices_[v].at.position;
  }
  glm::vec3 directionOf(const Triangle& t) const {
    const glm::vec3 a = vectorOf(positionOf(t.corner[0]));
    const glm::vec3 n = glm::cross(vectorOf(positionOf(t.corner[1])) - a, vectorOf(positionOf(t.corner[2])) - a);
    const float length2 = glm::dot(n, n);
    return length2 > 0.0F ? n / std::sqrt(length2) : glm::vec3(0.0F);
  }

  /// Lists the corners of each vertex, in the order of triangles.
  void linkCorners() {
    std::uint32_t first = 0;
    for (Vertex& vertex : vertices_) {
      vertex.first_corner = first;
      first += std::exchange(vertex.corners, 0);
    }
    // Lists that collapses make lie behind these.
    corners_.reserve(2 * std::size_t{first});
    corners_.resize(first);
    for (std::uint32_t t = 0; t < triangles_.size(); ++t)
      for (std::uint32_t k = 0; k < 3; ++k) {
        Vertex& vertex = vertices_[triangles_[t].corner[k]];
        corners_[vertex.first_corner + vertex.corners++] = cornerNumber(t, k);
      }
  }

  /// The corners at v. Triangles that are gone leave the list.
  std::span<const std::uint32_t> cornersAt(std::uint32_t v) {
    Vertex& vertex = vertices_[v];
    std::uint32_t* const list = corners_.data() + vertex.first_corner;
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < vertex.corners; ++i) {
      list[kept] = list[i];
      kept += triangles_[list[i] / 4].corner[0] != kNone ? 1 : 0;
    }
    vertex.corners = kept;
    return {list, kept};
  }

  /// Finds the triangles around v, and the vertices that share an edge with it. False: too many.
  bool findFan(std::uint32_t v) {
    spokes_.clear();
    neighbors_.clear();
    startMarks();
    const auto around = cornersAt(v);
    if (around.empty() || around.size() > kMaxStar) return false;
    const Triangle* const triangles = triangles_.data();
    for (const std::uint32_t corner : around) {
      const std::uint32_t t = corner / 4, k = corner % 4;
      const std::uint32_t* const c = triangles[t].corner.data();
      Spoke& spoke = spokes_.add();
      spoke.triangle = t;
      spoke.next = slotOf(c[k == 2 ? 0 : k + 1]);
      spoke.last = slotOf(c[k == 0 ? 2 : k - 1]);
    }
    return true;
  }
  void startMarks() {
    if (++stamp_ != 0) return;
    marks_.assign(marks_.size(), {});
    stamp_ = 1;
  }
  std::uint32_t slotOf(std::uint32_t w) {
    Mark& mark = marks_[w];
    if (mark.stamp != stamp_) {
      mark = {stamp_, static_cast<std::uint32_t>(neighbors_.size())};
      Neighbor& neighbor = neighbors_.add();
      neighbor.vertex = w;
      neighbor.triangles = 0;
    }
    ++neighbors_[mark.slot].triangles;
    return mark.slot;
  }

  const Attributes& neighborAt(std::uint32_t slot) const {
    return vertices_[neighbors_[slot].vertex].at;
  }

  /// How much collapses of v into four neighbours seem to move the surface: an order, no bound.
  Four costsOf(std::uint32_t v, const std::array<std::uint32_t, 4>& slots) const {
    const Attributes& from = vertices_[v].at;
    const std::array<const Attributes*, 4> to{&neighborAt(slots[0]), &neighborAt(slots[1]), &neighborAt(slots[2]),
                                              &neighborAt(slots[3])};
    const FourPoints along = side(to[0]->position - from.position, to[1]->position - from.position,
                                  to[2]->position - from.position, to[3]->position - from.position);
    Four height2{};
    for (const Spoke& spoke : spokes_) {
      const Four over = along.dot(triangles_[spoke.triangle].direction);
      const Four over2 = over * over;
      height2 = height2 < over2 ? over2 : height2;
    }
    Four off = Four{} + kLengthCost * kLengthCost;
    if (options_.normals) {
      const FourPoints turn = side(to[0]->normal - from.normal, to[1]->normal - from.normal,
                                   to[2]->normal - from.normal, to[3]->normal - from.normal);
      off += kTurnCost * kTurnCost * turn.dot(turn);
    }
    if (options_.colors) {
      const FourPoints color = side(to[0]->color - from.color, to[1]->color - from.color, to[2]->color - from.color,
                                    to[3]->color - from.color);
      off += kColorCost * kColorCost * color.dot(color);
    }
    return height2 + off * along.dot(along);
  }

  /// Finds the cheapest neighbours into which v might be collapsed. None where v has to stay.
  void findTargets(std::uint32_t v) {
    targets_.fill({});
    has_old_ = false;
    if (!findFan(v)) return;
    std::size_t open = 0;
    for (const Neighbor& n : neighbors_) {
      if (n.triangles > 2) return;
      open += n.triangles == 1 ? 1 : 0;
    }
    if (open > 2) return;
    const auto count = static_cast<std::uint32_t>(neighbors_.size());
    for (std::uint32_t first = 0; first < count; first += 4) {
      std::array<std::uint32_t, 4> slots{};
      for (std::uint32_t i = 0; i < 4; ++i) slots[i] = std::min(first + i, count - 1);
      const Four costs = costsOf(v, slots);
      for (std::uint32_t i = 0; i < 4 && first + i < count; ++i)
        if (open == 0 || neighbors_[first + i].triangles == 1) addTarget({first + i, costs[i]});
    }
  }
  void addTarget(Target target) {
    for (Target& other : targets_)
      if (target.cost < other.cost) std::swap(target, other);
  }

  void push(std::uint32_t v) {
    if (queue_.has(v)) return;
    findTargets(v);
    if (targets_[0].slot != kNone) queue_.push(v, targets_[0].cost);
  }

  /// Collapses v into the first of its targets that may be. A vertex that has to stay waits for a change around it.
  void tryVertex(std::uint32_t v) {
    for (const Target& target : targets_) {
      if (target.slot == kNone) return;
      const Neighbor& to = neighbors_[target.slot];
      if (keepsSides(target.slot) && keepsBorder(v, to) && keepsSamples(v, to.vertex) && keepsTopology(target.slot) &&
          keepsNear(v, target.slot))
        return collapse(v, to.vertex);
    }
  }

  /// The link condition: v and u have no common neighbours but those across from their edge.
  bool keepsTopology(std::uint32_t target) {
    for (Neighbor& n : neighbors_) n.is_common = false;
    const std::uint32_t u = neighbors_[target].vertex;
    const auto around = cornersAt(u);
    if (around.size() > kMaxStar) return false;
    std::uint32_t common = 0;
    const Triangle* const triangles = triangles_.data();
    for (const std::uint32_t corner : around)
      for (const std::uint32_t w : triangles[corner / 4].corner) {
        const Mark mark = marks_[w];
        if (w == u || mark.stamp != stamp_ || neighbors_[mark.slot].is_common) continue;
        neighbors_[mark.slot].is_common = true;
        ++common;
      }
    return common == neighbors_[target].triangles;
  }

  /// Finds the triangles that stay, and whether none turns over.
  bool keepsSides(std::uint32_t target) {
    staying_.clear();
    const glm::vec3 a = vectorOf(neighborAt(target).position);
    for (const Spoke& spoke : spokes_) {
      if (spoke.next == target || spoke.last == target) continue;
      staying_.push_back(spoke);
      const glm::vec3 after =
          glm::cross(vectorOf(neighborAt(spoke.next).position) - a, vectorOf(neighborAt(spoke.last).position) - a);
      const float after2 = glm::dot(after, after);
      if (!(after2 > 0.0F)) return false;
      const glm::vec3& before = triangles_[spoke.triangle].direction;
      if (before != glm::vec3(0.0F) && glm::dot(before, after) < kLeastCosine * std::sqrt(after2)) return false;
    }
    return !staying_.empty();
  }

  static std::uint64_t edgeKey(std::uint32_t a, std::uint32_t b) {
    return std::uint64_t{std::min(a, b)} << 32 | std::max(a, b);
  }

  /// Whether the open edge that takes the place of both of v's stays near to all vertices that lay on them. Distances
  /// to the surface would not tell: where the border is concave, the new triangles cover more than the old ones.
  bool keepsBorder(std::uint32_t v, const Neighbor& target) {
    border_end_ = kNone;
    if (target.triangles != 1) return true;
    for (const Neighbor& n : neighbors_)
      if (n.triangles == 1 && n.vertex != target.vertex) border_end_ = n.vertex;
    border_.assign(1, v);
    if (border_end_ == kNone) return false;
    for (const std::uint32_t end : {target.vertex, border_end_})
      if (const auto found = border_samples_.find(edgeKey(v, end)); found != border_samples_.end())
        border_.insert(border_.end(), found->second.begin(), found->second.end());
    const glm::vec3 from = vectorOf(positionOf(border_end_));
    const glm::vec3 along = vectorOf(positionOf(target.vertex)) - from;
    return std::all_of(border_.begin(), border_.end(), [&](std::uint32_t sample) {
      const glm::vec3 to = vectorOf(positionOf(sample)) - from;
      const glm::vec3 off = to - patch::builder::closestShare(to, along) * along;
      return glm::dot(off, off) <= vertices_[sample].room2;
    });
  }

  /// Whether the middles of the new edges are near the triangles before, and with what these carry near the source: a
  /// triangle across a hollow would leave all samples where they find other triangles.
  bool keepsNear(std::uint32_t v, std::uint32_t target) {
    if (!has_old_) findOld(v);
    const Attributes& u = neighborAt(target);
    for (std::uint32_t slot = 0; slot < neighbors_.size(); ++slot) {
      Neighbor& n = neighbors_[slot];
      n.reach = 0.0F;
      // Neighbours of both ends have their edge already.
      if (slot == target || n.is_common) continue;
      const Attributes& w = vertices_[n.vertex].at;
      const AppearanceOptions options = optionsFor(u, w);
      n.reach = reachOf(middleOf(u, w, options), options);
      if (!(n.reach <= limit_)) return false;
    }
    return true;
  }
  /// The appearance of a triangle in the middle of an edge.
  static Attributes middleOf(const Attributes& a, const Attributes& b, const AppearanceOptions& options) {
    Attributes middle{0.5F * (a.position + b.position), a.normal, 0.5F * (a.color + b.color)};
    if (!options.normals) return middle;
    const glm::vec3 normal = vectorOf(a.normal + b.normal);
    if (const float length2 = glm::dot(normal, normal); length2 > 0.0F)
      middle.normal = fourOf(normal / std::sqrt(length2));
    return middle;
  }
  /// The middle of a short edge is as near to its ends as samples are to each other.
  AppearanceOptions optionsFor(const Attributes& a, const Attributes& b) const {
    AppearanceOptions options = options_;
    const glm::vec3 along = vectorOf(a.position - b.position);
    if (glm::dot(along, along) < kLongEdge * kLongEdge * limit_ * limit_) options.normals = options.colors = false;
    return options;
  }
  float reachOf(const Attributes& place, const AppearanceOptions& options) const {
    Four least = Four{} + std::numeric_limits<float>::infinity();
    for (const OldTriangles& old : old_) {
      const Four error2 = old.shape.error2(place, options);
      const Four reach =
          Four{std::sqrt(error2[0]), std::sqrt(error2[1]), std::sqrt(error2[2]), std::sqrt(error2[3])} + old.reach;
      least = reach < least ? reach : least;
    }
    return lowestOf(least);
  }
  /// The triangles around v in fours.
  void findOld(std::uint32_t v) {
    old_.clear();
    has_old_ = true;
    const Attributes& a = vertices_[v].at;
    for (std::size_t first = 0; first < spokes_.size(); first += 4) {
      // Spokes that are left over come twice.
      const auto spoke = [&](std::size_t i) -> const Spoke& {
        return spokes_[std::min(first + i, spokes_.size() - 1)];
      };
      const auto corners = [&](std::uint32_t Spoke::*corner) {
        const auto at = [&](std::size_t i) -> const Attributes& { return neighborAt(spoke(i).*corner); };
        return attributesOf(at(0), at(1), at(2), at(3));
      };
      const auto reach = [&](std::size_t i) { return triangles_[spoke(i).triangle].reach; };
      old_.push_back({FourAppearances(attributesOf(a, a, a, a), corners(&Spoke::next), corners(&Spoke::last), options_),
                      Four{reach(0), reach(1), reach(2), reach(3)}});
    }
  }
  /// The attributes that count.
  FourAttributes attributesOf(const Attributes& a, const Attributes& b, const Attributes& c,
                              const Attributes& d) const {
    FourAttributes all{side(a.position, b.position, c.position, d.position), {}, {}};
    if (options_.normals) all.normal = side(a.normal, b.normal, c.normal, d.normal);
    if (options_.colors) all.color = side(a.color, b.color, c.color, d.color);
    return all;
  }

  /// Finds a place for each sample on the triangles that v's become.
  bool keepsSamples(std::uint32_t v, std::uint32_t u) {
    makeNew(u);
    placed_.clear();
    if (!place(v)) return false;
    for (const Spoke& spoke : spokes_)
      for (std::uint32_t s = triangles_[spoke.triangle].first_sample; s != kNone; s = vertices_[s].next_sample)
        if (!place(s)) return false;
    return true;
  }
  /// The triangles that stay, with u in the place of v, in fours.
  void makeNew(std::uint32_t u) {
    new_.clear();
    const Attributes& a = vertices_[u].at;
    for (std::size_t first = 0; first < staying_.size(); first += 4) {
      const auto spoke = [&](std::size_t i) -> const Spoke& {
        return staying_[std::min(first + i, staying_.size() - 1)];
      };
      const auto corners = [&](std::uint32_t Spoke::*corner) {
        const auto at = [&](std::size_t i) -> const Attributes& { return neighborAt(spoke(i).*corner); };
        return attributesOf(at(0), at(1), at(2), at(3));
      };
      new_.emplace_back(attributesOf(a, a, a, a), corners(&Spoke::next), corners(&Spoke::last), options_);
    }
  }
  bool place(std::uint32_t sample) {
    const Vertex& vertex = vertices_[sample];
    Four least = Four{} + std::numeric_limits<float>::infinity();
    base::Int4 best{};
    for (std::size_t i = 0; i < new_.size(); ++i) {
      const Four error2 = new_[i].error2(vertex.at, options_);
      const base::Int4 is_less = error2 < least;
      least = is_less ? error2 : least;
      best = is_less ? base::Int4{} + static_cast<std::int32_t>(i) : best;
    }
    const float error2 = lowestOf(least);
    if (!(error2 <= vertex.room2)) return false;
    const auto lane = static_cast<std::size_t>(std::countr_zero(base::bitsOf(least == error2)));
    const std::size_t at = std::min(4 * static_cast<std::size_t>(best[lane]) + lane, staying_.size() - 1);
    placed_.push_back({sample, staying_[at].triangle, error2});
    return true;
  }

  void collapse(std::uint32_t v, std::uint32_t u) {
    for (const Spoke& spoke : spokes_) {
      Triangle& t = triangles_[spoke.triangle];
      t.first_sample = kNone;
      if (neighbors_[spoke.next].vertex == u || neighbors_[spoke.last].vertex == u) {
        t.corner.fill(kNone);
        continue;
      }
      t.reach = std::max({t.reach, neighbors_[spoke.next].reach, neighbors_[spoke.last].reach});
    }
    moveCorners(v, u);
    for (const Placed& p : placed_) {
      vertices_[p.sample].next_sample = std::exchange(triangles_[p.triangle].first_sample, p.sample);
      vertices_[p.sample].first_corner = std::bit_cast<std::uint32_t>(p.error2);
    }
    if (border_end_ != kNone) {
      border_samples_.erase(edgeKey(v, u));
      border_samples_.erase(edgeKey(v, border_end_));
      border_samples_[edgeKey(u, border_end_)] = border_;
    }
    touched_.clear();
    for (const Neighbor& n : neighbors_) touched_.push_back(n.vertex);
    for (const std::uint32_t w : touched_) push(w);
  }

  /// The corners at v become u's.
  void moveCorners(std::uint32_t v, std::uint32_t u) {
    const auto first = static_cast<std::uint32_t>(corners_.size());
    for (const std::uint32_t from : {v, u}) {
      const Vertex& vertex = vertices_[from];
      for (std::uint32_t i = 0; i < vertex.corners; ++i) {
        const std::uint32_t corner = corners_[vertex.first_corner + i];
        Triangle& triangle = triangles_[corner / 4];
        if (triangle.corner[0] == kNone) continue;
        corners_.push_back(corner);
        if (from == u) continue;
        triangle.corner[corner % 4] = u;
        triangle.direction = directionOf(triangle);
      }
    }
    vertices_[u].first_corner = first;
    vertices_[u].corners = static_cast<std::uint32_t>(corners_.size()) - first;
    vertices_[v].corners = 0;
    survivor_[v] = u;
  }

  /// The largest error of the triangle's samples, with what they carried.
  float sampledError(const Triangle& triangle) {
    float largest = 0.0F;
    for (std::uint32_t s = triangle.first_sample; s != kNone; s = vertices_[s].next_sample) {
      const float carried = limit_ - std::sqrt(vertices_[s].room2);
      largest = std::max(largest, std::sqrt(std::bit_cast<float>(vertices_[s].first_corner)) + carried);
    }
    return largest;
  }

  Collapsed finish() {
    Collapsed out;
    for (std::uint32_t t = 0; t < triangles_.size(); ++t) {
      const auto& corner = triangles_[t].corner;
      if (corner[0] == kNone) continue;
      out.history.origin.push_back(t);
      out.errors.push_back(sampledError(triangles_[t]));
      out.history.indices.insert(out.history.indices.end(), corner.begin(), corner.end());
    }
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) {
      std::uint32_t end = v;
      while (survivor_[end] != end) end = survivor_[end];
      for (std::uint32_t at = v; survivor_[at] != end;) at = std::exchange(survivor_[at], end);
    }
    out.history.survivor = std::move(survivor_);
    return out;
  }

  const float limit_;
  const AppearanceOptions options_;
  std::vector<Vertex> vertices_;
  std::vector<Triangle> triangles_;
  std::vector<std::uint32_t> corners_;  // those of each vertex side by side
  std::vector<std::uint32_t> survivor_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> border_samples_;  // the vertices that lay on open edges
  VertexQueue queue_;

  // These belong to the vertex that is looked at.
  struct OldTriangles {
    FourAppearances shape;
    Four reach{};
  };
  ShortList<Spoke, kMaxStar> spokes_, staying_;
  ShortList<Neighbor, kMaxNeighbors> neighbors_;
  std::vector<Mark> marks_;  // by vertex: its slot among the neighbours, where the stamp is the last one
  std::uint32_t stamp_ = 0;
  std::array<Target, kTries> targets_;
  std::vector<OldTriangles> old_;
  bool has_old_ = false;
  std::vector<FourAppearances> new_;
  std::vector<Placed> placed_;
  std::vector<std::uint32_t> touched_;
  std::uint32_t border_end_ = kNone;   // the other end of v's other open edge; kNone: no open edge is collapsed
  std::vector<std::uint32_t> border_;  // the vertices that lay on both
};

void replaceTriangles(NodeMesh& mesh, Collapsed&& collapsed) {
  mesh.indices = std::move(collapsed.history.indices);
  dropUnusedVertices(mesh);
}

}  // namespace

Collapsed collapseWithin(const NodeMesh& mesh, float limit, const AppearanceOptions& options, Carried carried) {
  Collapser collapser(mesh, limit, options, carried);
#if defined(__x86_64__)
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  if (has_avx2) return collapser.runByAvx2();
#endif
  return collapser.run();
}

void applyCollapses(NodeMesh& mesh, Collapsed&& collapsed) {
  // Distances below half a lattice step are those of the lattice itself.
  constexpr float kNegligible = 0.5F;
  patch::builder::FacetSurface before;
  before.reset({mesh.positions, mesh.indices, {}, {}});
  mesh.bounds = patch::builder::carryError(before, mesh.bounds, {mesh.positions, collapsed.history.indices, {}, {}},
                                           collapsed.history, kNegligible, nullptr);
  for (std::size_t t = 0; t < collapsed.errors.size(); ++t)
    collapsed.errors[t] = std::max(collapsed.errors[t], mesh.errorOf(collapsed.history.origin[t]));
  mesh.errors = std::move(collapsed.errors);
  mesh.error = mesh.errors.empty() ? mesh.error : *std::max_element(mesh.errors.begin(), mesh.errors.end());
  replaceTriangles(mesh, std::move(collapsed));
}

void applyLastCollapses(NodeMesh& mesh, Collapsed&& collapsed) {
  mesh.bounds = {};
  mesh.errors.clear();
  replaceTriangles(mesh, std::move(collapsed));
}

}  // namespace lod::hlod::builder
