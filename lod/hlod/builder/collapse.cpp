#include "lod/hlod/builder/collapse.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <queue>
#include <unordered_map>
#include <utility>

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
constexpr float kColorCost = 1.0F / 128.0F;
// A vertex waits again where its collapse has become so many times as dear as when it was queued.
constexpr float kStaleCost = 2.0F;

class Collapser {
 public:
  Collapser(const NodeMesh& mesh, float limit, const AppearanceOptions& options, bool carries)
      : mesh_(mesh), limit_(limit), limit2_(limit * limit), options_(options) {
    const std::size_t triangles = mesh.triangles(), vertices = mesh.positions.size();
    corners_ = mesh.indices;
    alive_.assign(triangles, 1);
    reach_.assign(triangles, 0.0F);
    if (carries && !mesh.bounds.toward.empty()) {
      reach_ = mesh.bounds.from;
      room2_.assign(vertices, limit2_);
      for (std::size_t c = 0; c < corners_.size(); ++c) {
        const float room = std::max(limit - mesh.bounds.toward[c / 3], 0.0F);
        room2_[corners_[c]] = std::min(room2_[corners_[c]], room * room);
      }
    }
    next_corner_.assign(3 * triangles, kNone);
    first_corner_.assign(vertices, kNone);
    for (std::uint32_t c = static_cast<std::uint32_t>(corners_.size()); c-- > 0;) {
      next_corner_[c] = first_corner_[corners_[c]];
      first_corner_[corners_[c]] = c;
    }
    first_sample_.assign(triangles, kNone);
    next_sample_.assign(vertices, kNone);
    survivor_.resize(vertices);
    for (std::uint32_t v = 0; v < vertices; ++v) survivor_[v] = v;
    is_queued_.assign(vertices, 0);
    mark_.assign(vertices, 0);
    directions_.resize(triangles);
    for (std::uint32_t t = 0; t < triangles; ++t) directions_[t] = directionOf(t);
  }

  Collapsed run() {
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) push(v);
    while (!queue_.empty()) {
      const Candidate top = queue_.top();
      queue_.pop();
      is_queued_[top.vertex] = 0;
      if (survivor_[top.vertex] != top.vertex) continue;
      findTargets(top.vertex);
      if (targets_.empty()) continue;
      // The vertex' surroundings may have changed since it was queued.
      if (targets_.front().cost > kStaleCost * top.cost)
        enqueue(top.vertex, targets_.front().cost);
      else
        tryVertex(top.vertex);
    }
    return finish();
  }

 private:
  struct Candidate {
    float cost = 0.0F;
    std::uint32_t vertex = 0;
    bool operator<(const Candidate& other) const {
      return cost != other.cost ? cost > other.cost : vertex > other.vertex;
    }
  };
  struct Neighbor {
    std::uint32_t vertex = 0;
    std::uint32_t triangles = 0;  // at the edge
    float cost = 0.0F;
  };
  struct Placed {
    std::uint32_t sample = 0, triangle = 0;
  };

  Attributes attributesOf(std::uint32_t v) const {
    return {mesh_.positions[v], mesh_.normals[v], mesh_.colors.empty() ? glm::vec3(0.0F) : mesh_.colors[v]};
  }
  std::uint32_t corner(std::uint32_t t, std::uint32_t k) const { return corners_[3 * std::size_t{t} + k]; }
  glm::vec3 normalOf(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    const auto& p = mesh_.positions;
    return glm::cross(p[b] - p[a], p[c] - p[a]);
  }

  /// The unit normal, or zero.
  glm::vec3 directionOf(std::uint32_t t) const {
    const glm::vec3 n = normalOf(corner(t, 0), corner(t, 1), corner(t, 2));
    const float length2 = glm::dot(n, n);
    return length2 > 0.0F ? n / std::sqrt(length2) : glm::vec3(0.0F);
  }

  /// The triangles around v; those that are gone leave the vertex' list.
  void findStar(std::uint32_t v, std::vector<std::uint32_t>& star) {
    star.clear();
    std::uint32_t* link = &first_corner_[v];
    while (*link != kNone) {
      const std::uint32_t t = *link / 3;
      if (alive_[t] == 0) {
        *link = next_corner_[*link];
        continue;
      }
      star.push_back(t);
      link = &next_corner_[*link];
    }
  }

  /// The vertices that share an edge with v, and how many of its triangles each edge has.
  void findNeighbors(std::uint32_t v, const std::vector<std::uint32_t>& star, std::vector<Neighbor>& neighbors) {
    neighbors.clear();
    for (const std::uint32_t t : star)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t u = corner(t, k);
        if (u == v) continue;
        const auto found =
            std::find_if(neighbors.begin(), neighbors.end(), [u](const Neighbor& n) { return n.vertex == u; });
        if (found == neighbors.end())
          neighbors.push_back({u, 1, 0.0F});
        else
          ++found->triangles;
      }
  }

  /// How much a collapse of v into u seems to move the surface: an order, no bound.
  float costOf(std::uint32_t v, std::uint32_t u, const std::vector<std::uint32_t>& star) const {
    const glm::vec3 along = mesh_.positions[u] - mesh_.positions[v];
    const float length2 = glm::dot(along, along);
    float height2 = 0.0F;
    for (const std::uint32_t t : star) {
      const float over = glm::dot(directions_[t], along);
      height2 = std::max(height2, over * over);
    }
    float off = kLengthCost * kLengthCost;
    if (options_.normals) {
      const glm::vec3 turn = kTurnCost * (mesh_.normals[u] - mesh_.normals[v]);
      off += glm::dot(turn, turn);
    }
    if (options_.colors && !mesh_.colors.empty()) {
      const glm::vec3 color = kColorCost * (mesh_.colors[u] - mesh_.colors[v]);
      off += glm::dot(color, color);
    }
    return height2 + off * length2;
  }

  /// Sorts the neighbours into which v might be collapsed by cost. Empty where v has to stay.
  void findTargets(std::uint32_t v) {
    findStar(v, star_);
    targets_.clear();
    if (star_.empty() || star_.size() > kMaxStar) return;
    findNeighbors(v, star_, neighbors_);
    std::size_t open = 0;
    for (const Neighbor& n : neighbors_) {
      if (n.triangles > 2) return;
      open += n.triangles == 1 ? 1 : 0;
    }
    if (open > 2) return;
    for (const Neighbor& n : neighbors_) {
      if (open > 0 && n.triangles != 1) continue;
      targets_.push_back({n.vertex, n.triangles, costOf(v, n.vertex, star_)});
    }
    std::sort(targets_.begin(), targets_.end(), [](const Neighbor& a, const Neighbor& b) {
      return a.cost != b.cost ? a.cost < b.cost : a.vertex < b.vertex;
    });
  }

  void enqueue(std::uint32_t v, float cost) {
    queue_.push({cost, v});
    is_queued_[v] = 1;
  }
  void push(std::uint32_t v) {
    if (is_queued_[v] != 0) return;
    findTargets(v);
    if (!targets_.empty()) enqueue(v, targets_.front().cost);
  }

  /// Collapses v into the first of its targets that may be. A vertex that has to stay waits for a change around it.
  void tryVertex(std::uint32_t v) {
    for (std::size_t i = 0; i < std::min(targets_.size(), kTries); ++i)
      if (keepsTopology(v, targets_[i]) && keepsSides(v, targets_[i].vertex) && keepsBorder(v, targets_[i]) &&
          keepsNear(targets_[i].vertex) && keepsSamples(v, targets_[i].vertex))
        return collapse(v, targets_[i].vertex);
  }

  /// The link condition: v and u have no common neighbours but those across from their edge.
  bool keepsTopology(std::uint32_t v, const Neighbor& target) {
    findStar(target.vertex, target_star_);
    if (target_star_.size() > kMaxStar) return false;
    ++mark_now_;
    for (const Neighbor& n : neighbors_) mark_[n.vertex] = mark_now_;
    std::uint32_t common = 0;
    for (const std::uint32_t t : target_star_)
      for (std::uint32_t k = 0; k < 3; ++k) {
        const std::uint32_t w = corner(t, k);
        if (w == target.vertex || w == v || mark_[w] != mark_now_) continue;
        mark_[w] = 0;
        ++common;
      }
    return common == target.triangles;
  }

  bool has(std::uint32_t t, std::uint32_t v) const {
    return corner(t, 0) == v || corner(t, 1) == v || corner(t, 2) == v;
  }
  std::array<std::uint32_t, 3> moved(std::uint32_t t, std::uint32_t v, std::uint32_t u) const {
    std::array<std::uint32_t, 3> c{corner(t, 0), corner(t, 1), corner(t, 2)};
    std::replace(c.begin(), c.end(), v, u);
    return c;
  }

  bool keepsSides(std::uint32_t v, std::uint32_t u) const {
    bool any = false;
    for (const std::uint32_t t : star_) {
      if (has(t, u)) continue;
      any = true;
      const auto c = moved(t, v, u);
      const glm::vec3 after = normalOf(c[0], c[1], c[2]);
      const float after2 = glm::dot(after, after);
      if (!(after2 > 0.0F)) return false;
      const glm::vec3& before = directions_[t];
      if (before != glm::vec3(0.0F) && glm::dot(before, after) < kLeastCosine * std::sqrt(after2)) return false;
    }
    return any;
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
    const glm::vec3& from = mesh_.positions[border_end_];
    const glm::vec3 along = mesh_.positions[target.vertex] - from;
    return std::all_of(border_.begin(), border_.end(), [&](std::uint32_t sample) {
      const glm::vec3 to = mesh_.positions[sample] - from;
      const glm::vec3 off = to - patch::builder::closestShare(to, along) * along;
      return glm::dot(off, off) <= limit2_;
    });
  }

  /// Whether the middles of the new edges are near the triangles before, and with what these carry near the source: a
  /// triangle across a hollow would leave all samples where they find other triangles.
  bool keepsNear(std::uint32_t u) {
    new_reach_.clear();
    for (const Neighbor& n : neighbors_) {
      float reach = 0.0F;
      // Neighbours of both ends have their edge already; keepsTopology() left a mark at all others.
      if (n.vertex != u && mark_[n.vertex] == mark_now_) {
        const glm::vec3 middle = 0.5F * (mesh_.positions[u] + mesh_.positions[n.vertex]);
        reach = std::numeric_limits<float>::infinity();
        for (const std::uint32_t t : star_) reach = std::min(reach, distanceTo(t, middle) + reach_[t]);
        if (!(reach <= limit_)) return false;
      }
      new_reach_.push_back(reach);
    }
    return true;
  }
  float distanceTo(std::uint32_t t, const glm::vec3& place) const {
    const glm::vec3& a = mesh_.positions[corner(t, 0)];
    const glm::vec3& b = mesh_.positions[corner(t, 1)];
    const glm::vec3& c = mesh_.positions[corner(t, 2)];
    const glm::vec3 w = closestWeights(place, a, b, c);
    return glm::distance(place, w.x * a + w.y * b + w.z * c);
  }
  float reachAt(std::uint32_t v) const {
    for (std::size_t i = 0; i < neighbors_.size(); ++i)
      if (neighbors_[i].vertex == v) return new_reach_[i];
    return 0.0F;
  }

  /// Finds a place for each sample on the triangles that v's become.
  bool keepsSamples(std::uint32_t v, std::uint32_t u) {
    new_.clear();
    for (const std::uint32_t t : star_) {
      if (has(t, u)) continue;
      const auto c = moved(t, v, u);
      new_.emplace_back(t, AppearanceTriangle(attributesOf(c[0]), attributesOf(c[1]), attributesOf(c[2]), options_));
    }
    placed_.clear();
    new_error2_ = 0.0F;
    if (!place(v)) return false;
    for (const std::uint32_t t : star_)
      for (std::uint32_t s = first_sample_[t]; s != kNone; s = next_sample_[s])
        if (!place(s)) return false;
    return true;
  }
  bool place(std::uint32_t sample) {
    const Attributes at = attributesOf(sample);
    float least = std::numeric_limits<float>::infinity();
    std::uint32_t best = kNone;
    for (const auto& [t, triangle] : new_)
      if (const float e2 = triangle.error2(at, least); e2 < least) least = e2, best = t;
    if (!(least <= (room2_.empty() ? limit2_ : room2_[sample]))) return false;
    placed_.push_back({sample, best});
    new_error2_ = std::max(new_error2_, least);
    return true;
  }

  void collapse(std::uint32_t v, std::uint32_t u) {
    for (const std::uint32_t t : star_) {
      first_sample_[t] = kNone;
      if (has(t, u)) {
        alive_[t] = 0;
        continue;
      }
      for (std::uint32_t k = 0; k < 3; ++k)
        if (corner(t, k) != v) reach_[t] = std::max(reach_[t], reachAt(corner(t, k)));
    }
    for (const Placed& p : placed_) {
      next_sample_[p.sample] = first_sample_[p.triangle];
      first_sample_[p.triangle] = p.sample;
    }
    // The corners at v go to u's list.
    std::uint32_t last = kNone;
    for (std::uint32_t c = first_corner_[v]; c != kNone; c = next_corner_[c]) {
      corners_[c] = u;
      last = c;
    }
    next_corner_[last] = first_corner_[u];
    first_corner_[u] = first_corner_[v];
    first_corner_[v] = kNone;
    survivor_[v] = u;
    for (const std::uint32_t t : star_)
      if (alive_[t] != 0) directions_[t] = directionOf(t);
    if (border_end_ != kNone) {
      border_samples_.erase(edgeKey(v, u));
      border_samples_.erase(edgeKey(v, border_end_));
      border_samples_[edgeKey(u, border_end_)] = border_;
    }
    error2_ = std::max(error2_, new_error2_);
    touched_.clear();
    for (const Neighbor& n : neighbors_) touched_.push_back(n.vertex);
    for (const std::uint32_t w : touched_) push(w);
  }

  Collapsed finish() {
    Collapsed out;
    out.error = std::sqrt(error2_);
    for (std::uint32_t t = 0; t < alive_.size(); ++t) {
      if (alive_[t] == 0) continue;
      out.history.origin.push_back(t);
      for (std::uint32_t k = 0; k < 3; ++k) out.history.indices.push_back(corner(t, k));
    }
    for (std::uint32_t v = 0; v < survivor_.size(); ++v) {
      std::uint32_t end = v;
      while (survivor_[end] != end) end = survivor_[end];
      for (std::uint32_t at = v; survivor_[at] != end;) at = std::exchange(survivor_[at], end);
    }
    out.history.survivor = std::move(survivor_);
    return out;
  }

  const NodeMesh& mesh_;
  const float limit_, limit2_;
  const AppearanceOptions options_;
  std::vector<std::uint32_t> corners_;
  std::vector<std::uint8_t> alive_;
  std::vector<float> reach_;  // about how far a triangle's places are from the mesh before, or from the source
  std::vector<float> room2_;  // by vertex, where bounds are carried: the square of what it may be off
  std::vector<std::uint32_t> next_corner_, first_corner_;                         // the corners at each vertex
  std::vector<std::uint32_t> first_sample_, next_sample_;                         // the samples on each triangle
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> border_samples_;  // the vertices that lay on open edges
  std::vector<std::uint32_t> survivor_;
  std::vector<std::uint8_t> is_queued_;
  std::vector<glm::vec3> directions_;  // unit normals of triangles, or zero
  std::vector<std::uint32_t> mark_;
  std::uint32_t mark_now_ = 0;
  std::priority_queue<Candidate> queue_;
  float error2_ = 0.0F;

  // These belong to the vertex that is looked at.
  std::vector<std::uint32_t> star_, target_star_, touched_;
  std::vector<Neighbor> neighbors_, targets_;
  std::vector<std::pair<std::uint32_t, AppearanceTriangle>> new_;
  std::vector<Placed> placed_;
  std::uint32_t border_end_ = kNone;   // the other end of v's other open edge; kNone: no open edge is collapsed
  std::vector<std::uint32_t> border_;  // the vertices that lay on both
  std::vector<float> new_reach_;       // by neighbour: the reach of its new edge
  float new_error2_ = 0.0F;
};

}  // namespace

Collapsed collapseWithin(const NodeMesh& mesh, float limit, const AppearanceOptions& options, bool carries) {
  return Collapser(mesh, limit, options, carries).run();
}

void applyCollapses(NodeMesh& mesh, Collapsed&& collapsed) {
  // Distances below half a lattice step are those of the lattice itself.
  constexpr float kNegligible = 0.5F;
  patch::builder::FacetSurface before;
  before.reset({mesh.positions, mesh.indices, {}, {}});
  patch::builder::TypicalError typical;
  mesh.bounds = patch::builder::carryError(before, mesh.bounds, {mesh.positions, collapsed.history.indices, {}, {}},
                                           collapsed.history, kNegligible, typical);
  mesh.indices = std::move(collapsed.history.indices);
  mesh.error += collapsed.error;
  dropUnusedVertices(mesh);
}

}  // namespace lod::hlod::builder
