#include "lod/patch/builder/partition.h"

#include <metis.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <mutex>
#include <numeric>

#include "lod/ingest/disjoint_sets.h"
#include "lod/patch/builder/bisection.h"
#include "lod/patch/builder/voxels.h"

namespace lod::patch::builder {
namespace {

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
