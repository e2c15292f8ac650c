#include "lod/patch/builder/partition.h"

#include <metis.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <numeric>
#include <span>

#include "lod/ingest/disjoint_sets.h"
#include "lod/patch/builder/voxels.h"

namespace lod::patch::builder {
namespace {

// ---- Small graphs ----

// Cuts small graphs in two: one side grows from a vertex far out (graph growing), then vertices change sides while that
// shortens the cut (Fiduccia and Mattheyses 1982, "A Linear-Time Heuristic for Improving Network Partitions"), from
// several starts. Up to a few hundred vertices this finds cuts as short as multilevel methods do, in less time, and
// needs no random numbers.

// With four starts, cuts of voxel graphs are as short as METIS makes them; with three they are a hundredth longer.
constexpr std::size_t kStarts = 4;
constexpr std::size_t kMaxPasses = 6;  // most graphs need two or three

// The cost of a division: weight beyond the limits, then the length of the cut, then the distance from the target.
struct Cost {
  std::int64_t excess = 0;
  std::int64_t cut = 0;
  std::int64_t off_target = 0;
  auto operator<=>(const Cost&) const = default;
};

class Bisection {
 public:
  Bisection(const Graph& graph, const BisectionTarget& target)
      : graph_(graph),
        target_(target),
        size_(static_cast<std::uint32_t>(graph.size())),
        sign_(size_),
        gain_(size_),
        degree_(size_, 0),
        near_{std::vector<std::uint32_t>(size_ + 1), std::vector<std::uint32_t>(size_ + 1)},
        order_(size_ + 1),
        seen_(size_),
        fruitless_moves_(std::max(12U, size_ / 14)) {
    for (std::uint32_t v = 0; v < size_; ++v) {
      total_ += graph.vertex_weights[v];
      forEachNeighbor(v, [&](std::uint32_t, std::int32_t w) { degree_[v] += w; });
    }
  }

  std::vector<std::int32_t> run() {
    std::vector<std::int32_t> best;
    Cost best_cost;
    // Starts lie far from each other: each is the last vertex to be reached from those before it.
    std::array<std::uint32_t, kStarts> starts{};
    breadthFirst(std::span(starts).first(1));
    for (std::size_t s = 0; s < kStarts; ++s) {
      starts[s] = order_[size_ - 1];
      breadthFirst(std::span(starts).subspan(s, 1));
      grow();
      for (std::size_t pass = 0; pass < kMaxPasses && refine(); ++pass) continue;
      if (best.empty() || cost() < best_cost) best = sign_, best_cost = cost();
      if (s > 0) breadthFirst(std::span(starts).first(s + 1));
    }
    for (std::int32_t& s : best) s = s < 0 ? 0 : 1;
    return best;
  }

 private:
  // Calls body(neighbour, weight of the edge).
  template <class Body>
  void forEachNeighbor(std::uint32_t v, Body&& body) const {
    const std::int32_t* neighbors = graph_.neighbors.data();
    const std::int32_t* weights = graph_.edge_weights.data();
    const std::int32_t end = graph_.row[v + 1];
    for (std::int32_t e = graph_.row[v]; e < end; ++e) body(static_cast<std::uint32_t>(neighbors[e]), weights[e]);
  }

  // Lists all vertices in order_, those nearest to `from` first. Other components follow by number.
  void breadthFirst(std::span<const std::uint32_t> from) {
    std::fill(seen_.begin(), seen_.end(), 0);
    std::uint8_t* seen = seen_.data();
    std::uint32_t* order = order_.data();
    std::uint32_t count = 0;
    // No branch could predict whether a vertex is new.
    const auto add = [&](std::uint32_t v) {
      order[count] = v;
      count += 1U - seen[v];
      seen[v] = 1;
    };
    for (const std::uint32_t v : from) add(v);
    std::uint32_t unseen = 0;
    for (std::uint32_t next = 0; next < size_; ++next) {
      while (next == count) add(unseen++);
      forEachNeighbor(order[next], [&](std::uint32_t u, std::int32_t) { add(u); });
    }
  }

  // The first vertices of order_ become side 0.
  void grow() {
    std::fill(sign_.begin(), sign_.end(), 1);
    left_ = 0;
    for (std::uint32_t i = 0; i + 1 < size_ && (i == 0 || left_ < target_.weight); ++i) {
      sign_[order_[i]] = -1;
      left_ += graph_.vertex_weights[order_[i]];
    }
    std::int64_t sum = 0;
    for (std::uint32_t v = 0; v < size_; ++v) {
      std::int32_t within = 0;
      forEachNeighbor(v, [&](std::uint32_t u, std::int32_t w) { within += w * sign_[u]; });
      gain_[v] = -within * sign_[v];
      sum += degree_[v] + gain_[v];  // twice the weight of the edges to the other side
    }
    cut_ = sum / 4;
  }

  Cost cost() const {
    if (left_ == 0 || left_ == total_)
      return {std::numeric_limits<std::int64_t>::max(), cut_, 0};  // an empty side is worse than any weight
    return {std::max<std::int64_t>({0, left_ - target_.max, target_.min - left_}), cut_,
            std::abs(left_ - target_.weight)};
  }

  // Moves the vertex to the other side.
  void move(std::uint32_t v) {
    const std::int32_t from = sign_[v];
    cut_ -= gain_[v];
    left_ += from * graph_.vertex_weights[v];
    sign_[v] = -from;
    gain_[v] = -gain_[v];
    std::int32_t* gain = gain_.data();
    const std::int32_t* sign = sign_.data();
    forEachNeighbor(v, [&](std::uint32_t u, std::int32_t w) { gain[u] += 2 * w * from * sign[u]; });
  }

  // Makes one pass. Each vertex moves once at most, from the side that is too heavy, the one that shortens the cut the
  // most first; then the pass goes back to its best division. False when that is the one it started from.
  bool refine() {
    findNear();
    moved_.clear();
    Cost best = cost();
    std::size_t kept = 0;
    while (moved_.size() < kept + fruitless_moves_) {
      const std::size_t from = left_ > target_.weight ? 0 : 1;
      if (near_count_[from] == 0) break;
      const std::uint32_t v = takeBestVertex(from);
      move(v);
      forEachNeighbor(v, [&](std::uint32_t u, std::int32_t) { addNear(u); });
      moved_.push_back(v);
      if (const Cost now = cost(); now < best) best = now, kept = moved_.size();
    }
    for (; moved_.size() > kept; moved_.pop_back()) move(moved_.back());
    return kept > 0;
  }

  void findNear() {
    near_count_ = {0, 0};
    std::fill(seen_.begin(), seen_.end(), 0);
    for (std::uint32_t v = 0; v < size_; ++v)
      if (gain_[v] != -degree_[v]) addNear(v);
  }

  void addNear(std::uint32_t v) {
    const std::size_t side = sign_[v] < 0 ? 0 : 1;
    near_[side][near_count_[side]] = v;
    near_count_[side] += 1U - seen_[v];
    seen_[v] = 1;
  }

  static constexpr std::int64_t kPlaces = std::int64_t{1} << 32;
  std::uint32_t takeBestVertex(std::size_t side) {
    std::uint32_t* near = near_[side].data();
    std::uint32_t& count = near_count_[side];
    const std::int32_t* gain = gain_.data();
    // Gain and place make one number, so the greatest is found without branches.
    std::int64_t best = std::numeric_limits<std::int64_t>::min();
    for (std::uint32_t i = 0; i < count; ++i) best = std::max(best, std::int64_t{gain[near[i]]} * kPlaces + i);
    const auto at = static_cast<std::uint32_t>(best & (kPlaces - 1));
    const std::uint32_t v = near[at];
    near[at] = near[--count];
    return v;
  }

  const Graph& graph_;
  const BisectionTarget target_;
  const std::uint32_t size_;
  std::vector<std::int32_t> sign_;    // −1: side 0, 1: side 1
  std::vector<std::int32_t> gain_;    // how much shorter the cut is once the vertex has changed sides
  std::vector<std::int32_t> degree_;  // weight of the vertex's edges
  std::int64_t cut_ = 0;
  std::int64_t left_ = 0;  // weight of side 0
  std::int64_t total_ = 0;
  // During a pass: the vertices of each side at the cut that have not moved yet, and those that have.
  std::array<std::vector<std::uint32_t>, 2> near_;
  std::array<std::uint32_t, 2> near_count_{};
  std::vector<std::uint32_t> moved_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> seen_;
  const std::uint32_t fruitless_moves_;  // a pass ends after this many moves without a better division
};

// ---- Large graphs ----

static_assert(sizeof(idx_t) == sizeof(std::int32_t), "METIS must be built with 32-bit indices");

std::mutex& metisMutex() {
  static std::mutex mutex;
  return mutex;
}

enum class MetisMethod { kRecursive, kKway };

// Calls METIS. False when METIS refuses (out of memory); the caller then divides by the order of the vertices.
bool callMetis(MetisMethod method, const Graph& graph, std::int32_t parts, std::vector<float>& shares,
               std::vector<std::int32_t>& part) {
  std::array<idx_t, METIS_NOPTIONS> options{};
  METIS_SetDefaultOptions(options.data());
  options[METIS_OPTION_SEED] = 1;
  options[METIS_OPTION_UFACTOR] =
      method == MetisMethod::kKway ? 100 : 20;  // parts may be 10 % or 2 % heavier than their share

  auto size = static_cast<idx_t>(graph.size());
  idx_t constraints = 1;
  idx_t cut = 0;
  // METIS takes its input through pointers to non-const, and leaves it as it is.
  auto input = [](const std::vector<std::int32_t>& v) { return const_cast<idx_t*>(v.data()); };
  part.assign(graph.size(), 0);
  const auto function = method == MetisMethod::kKway ? METIS_PartGraphKway : METIS_PartGraphRecursive;
  const std::lock_guard lock(metisMutex());
  return function(&size, &constraints, input(graph.row), input(graph.neighbors), input(graph.vertex_weights), nullptr,
                  input(graph.edge_weights), &parts, shares.empty() ? nullptr : shares.data(), nullptr, options.data(),
                  &cut, part.data()) == METIS_OK;
}

// Side 0 gets the first vertices in order, up to `share` of the weight; both sides get at least one.
void splitByOrder(const Graph& graph, double share, std::vector<std::int32_t>& part) {
  const double total = std::accumulate(graph.vertex_weights.begin(), graph.vertex_weights.end(), 0.0);
  double sum = 0.0;
  part.assign(graph.size(), 1);
  part[0] = 0;
  for (std::size_t v = 0; v + 1 < graph.size(); ++v) {
    sum += graph.vertex_weights[v];
    if (v > 0 && sum > share * total) break;
    part[v] = 0;
  }
}

// The vertices of one side, with the edges among them. `local` is scratch as long as the graph.
Graph inducedGraph(const Graph& graph, const std::vector<std::int32_t>& part, std::int32_t side,
                   std::vector<std::int32_t>& local) {
  std::int32_t count = 0;
  for (std::size_t v = 0; v < graph.size(); ++v) local[v] = part[v] == side ? count++ : -1;
  Graph sub;
  const std::size_t edges = graph.neighbors.size() * static_cast<std::size_t>(count) / graph.size();
  sub.row.reserve(static_cast<std::size_t>(count) + 1);
  sub.vertex_weights.reserve(static_cast<std::size_t>(count));
  sub.neighbors.reserve(edges + edges / 16);
  sub.edge_weights.reserve(edges + edges / 16);
  for (std::size_t v = 0; v < graph.size(); ++v) {
    if (local[v] < 0) continue;
    for (auto e = static_cast<std::size_t>(graph.row[v]); e < static_cast<std::size_t>(graph.row[v + 1]); ++e) {
      const std::int32_t other = local[static_cast<std::size_t>(graph.neighbors[e])];
      if (other < 0) continue;
      sub.neighbors.push_back(other);
      sub.edge_weights.push_back(graph.edge_weights[e]);
    }
    sub.row.push_back(static_cast<std::int32_t>(sub.neighbors.size()));
    sub.vertex_weights.push_back(graph.vertex_weights[v]);
  }
  return sub;
}

// Finds the component of each vertex, numbered 0, 1, … by first vertex; returns their count.
std::uint32_t connectedComponents(const Graph& graph, std::vector<std::int32_t>& component) {
  ingest::DisjointSets sets(graph.size());
  for (std::uint32_t v = 0; v < graph.size(); ++v)
    for (auto e = static_cast<std::size_t>(graph.row[v]); e < static_cast<std::size_t>(graph.row[v + 1]); ++e)
      sets.unite(v, static_cast<std::uint32_t>(graph.neighbors[e]));
  component.resize(graph.size());
  std::int32_t count = 0;
  for (std::uint32_t v = 0; v < graph.size(); ++v) {
    const std::uint32_t first = sets.find(v);
    component[v] = first == v ? count++ : component[first];
  }
  return static_cast<std::uint32_t>(count);
}

class RecursiveBisection {
 public:
  RecursiveBisection(const Graph& graph, std::int64_t max_weight, std::span<const Extent> extents)
      : part_(graph.size(), 0), max_weight_(max_weight), extents_(extents) {
    Extent all;
    for (const Extent& e : extents) all.add(e);
    const double weight = std::accumulate(graph.vertex_weights.begin(), graph.vertex_weights.end(), 0.0);
    widest_ = kSpread * all.diagonal() * std::sqrt(static_cast<double>(max_weight) / std::max(1.0, weight));
  }

  void run(const Graph& graph, const std::vector<std::uint32_t>& vertices) {
    std::vector<std::int32_t> component;
    const std::uint32_t count = connectedComponents(graph, component);
    if (count == 1) return cutConnected(graph, vertices);
    std::vector<Part> pieces(count);
    for (std::size_t v = 0; v < graph.size(); ++v) {
      Part& p = pieces[static_cast<std::size_t>(component[v])];
      p.weight += graph.vertex_weights[v];
      if (!extents_.empty()) p.extent.add(extents_[vertices[v]]);
    }
    packComponents(pieces);
    for (std::size_t v = 0; v < graph.size(); ++v) {
      const Part& p = pieces[static_cast<std::size_t>(component[v])];
      if (p.number != kNone) part_[vertices[v]] = p.number;
    }
    std::vector<std::int32_t> local(graph.size());
    for (std::uint32_t p = 0; p < count; ++p) {
      if (pieces[p].number != kNone) continue;
      std::vector<std::uint32_t> below;
      for (std::size_t v = 0; v < graph.size(); ++v)
        if (component[v] == static_cast<std::int32_t>(p)) below.push_back(vertices[v]);
      cutConnected(inducedGraph(graph, component, static_cast<std::int32_t>(p), local), below);
    }
  }
  std::vector<std::uint32_t> takeParts() { return std::move(part_); }

 private:
  // Up to this many vertices METIS takes longer than bisect() and cuts no better (measured on voxel graphs of scans).
  static constexpr std::size_t kMaxBisected = 1024;
  // 7 % of a part stay free for imbalance and heavy vertices, so that few parts need one more cut. The share is a
  // choice: with less room more parts are cut once more, with more room parts are smaller than they may be.
  static constexpr double kFilled = 0.93;

  // Small components share a part if it is at most this many times as wide as a part of one surface (partition.h). The
  // ratio is a choice: wider parts simplify badly (docs/decisions/leaf-patches-near.md), narrower ones leave more small
  // parts.
  static constexpr double kSpread = 2.0;
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  struct Part {
    std::int64_t weight = 0;
    Extent extent;
    std::uint32_t number = kNone;
  };

  // Numbers components that fit into one part: each goes to the nearest of the last few parts that have room.
  void packComponents(std::vector<Part>& pieces) {
    // A choice: more open parts are searched longer, and from fewer the nearest may have gone already.
    constexpr std::size_t kOpen = 16;
    std::vector<Part> open;
    for (Part& piece : pieces) {
      if (piece.weight > max_weight_) continue;
      Part* best = nullptr;
      double best_width = widest_;
      for (Part& part : open) {
        if (part.weight + piece.weight > max_weight_) continue;
        Extent both = part.extent;
        both.add(piece.extent);
        if (const double width = both.diagonal(); extents_.empty() || width <= best_width) {
          best = &part;
          best_width = width;
        }
      }
      if (best == nullptr) {
        if (open.size() == kOpen) open.erase(open.begin());
        open.push_back({0, {}, next_part_++});
        best = &open.back();
      }
      best->weight += piece.weight;
      best->extent.add(piece.extent);
      piece.number = best->number;
    }
  }

  // Divides a connected graph.
  void cutConnected(const Graph& graph, const std::vector<std::uint32_t>& vertices) {
    const std::int64_t weight =
        std::accumulate(graph.vertex_weights.begin(), graph.vertex_weights.end(), std::int64_t{0});
    if (weight <= max_weight_ || graph.size() < 2) {
      for (const std::uint32_t v : vertices) part_[v] = next_part_;
      ++next_part_;
      return;
    }
    const std::vector<std::int32_t> side = twoSides(graph, weight);
    std::vector<std::int32_t> local(graph.size());
    for (const std::int32_t s : {0, 1}) {
      std::vector<std::uint32_t> below;
      for (std::size_t v = 0; v < graph.size(); ++v)
        if (side[v] == s) below.push_back(vertices[v]);
      run(inducedGraph(graph, side, s, local), below);
    }
  }

  std::vector<std::int32_t> twoSides(const Graph& graph, std::int64_t weight) const {
    const auto max_weight = static_cast<double>(max_weight_);
    const double needed = std::max(2.0, std::ceil(static_cast<double>(weight) / (kFilled * max_weight)));
    const double left = std::floor(needed / 2.0);
    if (graph.size() <= kMaxBisected) {
      const auto whole = static_cast<double>(weight);
      BisectionTarget target;
      target.weight = std::llround(left / needed * whole);
      target.max = maxOfSide(left, left / needed * whole);
      target.min = weight - maxOfSide(needed - left, (needed - left) / needed * whole);
      return bisect(graph, target);
    }
    std::vector<float> shares{static_cast<float>(left / needed), static_cast<float>(1.0 - left / needed)};
    std::vector<std::int32_t> side;
    const bool done = callMetis(MetisMethod::kRecursive, graph, 2, shares, side);
    const auto zeros = std::count(side.begin(), side.end(), 0);
    if (!done || zeros == 0 || zeros == static_cast<std::ptrdiff_t>(side.size()))
      splitByOrder(graph, left / needed, side);
    return side;
  }

  // The largest weight of a side of so many parts. A single part may be full; several must not need one more. It is
  // between 2 % and 10 % over the side's share.
  std::int64_t maxOfSide(double parts, double share) const {
    const double room = (parts > 1.0 ? kFilled : 1.0) * parts * static_cast<double>(max_weight_);
    return static_cast<std::int64_t>(std::clamp(room, 1.02 * share, 1.1 * share));
  }

  std::vector<std::uint32_t> part_;
  std::int64_t max_weight_;
  std::span<const Extent> extents_;
  double widest_ = 0.0;
  std::uint32_t next_part_ = 0;
};

// The same parts, numbered 0, 1, … in order of their first vertex.
std::vector<std::uint32_t> withoutGaps(const std::vector<std::int32_t>& part, std::uint32_t parts) {
  std::vector<std::uint32_t> number(parts, std::numeric_limits<std::uint32_t>::max());
  std::vector<std::uint32_t> result(part.size());
  std::uint32_t next = 0;
  for (std::size_t v = 0; v < part.size(); ++v) {
    std::uint32_t& n = number[static_cast<std::size_t>(part[v])];
    if (n == std::numeric_limits<std::uint32_t>::max()) n = next++;
    result[v] = n;
  }
  return result;
}

}  // namespace

std::vector<std::int32_t> bisect(const Graph& graph, const BisectionTarget& target) {
  return Bisection(graph, target).run();
}

Graph graphFromEdges(std::vector<std::int32_t> vertex_weights, std::vector<WeightedEdge> edges) {
  // Each pair once, the smaller vertex first, weights summed.
  std::erase_if(edges, [](const WeightedEdge& e) { return e.a == e.b; });
  for (WeightedEdge& e : edges)
    if (e.a > e.b) std::swap(e.a, e.b);
  const std::uint64_t vertices = vertex_weights.size();
  std::vector<ingest::KeyedIndex> order(edges.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = {edges[i].a * vertices + edges[i].b, i};
  ingest::radixSort(order, static_cast<std::uint32_t>(std::bit_width(vertices * vertices)));
  std::vector<WeightedEdge> merged;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i > 0 && order[i].key == order[i - 1].key)
      merged.back().weight += edges[order[i].index].weight;
    else
      merged.push_back(edges[order[i].index]);
  }
  edges = std::move(merged);
  const std::size_t kept = edges.size();

  // Store each edge in both directions, sorted into rows by vertex.
  Graph graph;
  graph.vertex_weights = std::move(vertex_weights);
  graph.row.assign(graph.size() + 1, 0);
  for (const WeightedEdge& e : edges) ++graph.row[e.a + 1], ++graph.row[e.b + 1];
  std::partial_sum(graph.row.begin(), graph.row.end(), graph.row.begin());
  graph.neighbors.resize(2 * kept);
  graph.edge_weights.resize(2 * kept);
  std::vector<std::int32_t> next(graph.row.begin(), graph.row.end() - 1);
  auto put = [&](std::uint32_t from, std::uint32_t to, std::int32_t weight) {
    const auto slot = static_cast<std::size_t>(next[from]++);
    graph.neighbors[slot] = static_cast<std::int32_t>(to);
    graph.edge_weights[slot] = weight;
  };
  for (const WeightedEdge& e : edges) put(e.a, e.b, e.weight), put(e.b, e.a, e.weight);
  return graph;
}

std::vector<std::uint32_t> components(std::size_t vertices, std::span<const WeightedEdge> edges) {
  ingest::DisjointSets sets(vertices);
  for (const WeightedEdge& e : edges) sets.unite(e.a, e.b);
  return std::move(sets).roots();
}

void tieComponents(std::span<const std::uint32_t> order, std::vector<WeightedEdge>& edges) {
  const std::vector<std::uint32_t> component = components(order.size(), edges);
  for (std::size_t i = 1; i < order.size(); ++i)
    if (component[order[i - 1]] != component[order[i]]) edges.push_back({order[i - 1], order[i], 1});
}

std::vector<std::uint32_t> partitionRecursively(const Graph& graph, std::int64_t max_weight,
                                                std::span<const Extent> extents) {
  RecursiveBisection bisection(graph, max_weight, extents);
  std::vector<std::uint32_t> all(graph.size());
  std::iota(all.begin(), all.end(), 0U);
  if (!all.empty()) bisection.run(graph, all);
  return bisection.takeParts();
}

std::vector<std::uint32_t> partitionIntoParts(const Graph& graph, std::uint32_t parts) {
  if (parts <= 1 || graph.size() <= 1) return std::vector<std::uint32_t>(graph.size(), 0);
  std::vector<float> equal_shares;
  std::vector<std::int32_t> part;
  const MetisMethod method = parts > 8 ? MetisMethod::kKway : MetisMethod::kRecursive;
  if (!callMetis(method, graph, static_cast<std::int32_t>(parts), equal_shares, part))
    for (std::size_t v = 0; v < part.size(); ++v) part[v] = static_cast<std::int32_t>(v * parts / part.size());
  return withoutGaps(part, parts);
}

}  // namespace lod::patch::builder
