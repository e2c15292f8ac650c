#include "lod/build/partition.h"

#include <metis.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>

#include "lod/build/bisection.h"
#include "lod/build/voxels.h"

namespace lod::build {
namespace {

static_assert(sizeof(idx_t) == sizeof(std::int32_t), "METIS must be built with 32-bit indices");

std::mutex& metisMutex() {
  static std::mutex mutex;
  return mutex;
}

enum class Kind { kRecursive, kKway };

// One METIS call. False when METIS refuses (out of memory): the caller then falls back to the order of the vertices.
bool callMetis(Kind kind, const Graph& graph, std::int32_t parts, std::vector<float>& shares,
               std::vector<std::int32_t>& part) {
  std::array<idx_t, METIS_NOPTIONS> options{};
  METIS_SetDefaultOptions(options.data());
  options[METIS_OPTION_SEED] = 1;
  options[METIS_OPTION_UFACTOR] = kind == Kind::kKway ? 100 : 20;  // parts may be 10 % or 2 % heavier than their share

  auto size = static_cast<idx_t>(graph.size());
  idx_t constraints = 1;
  idx_t cut = 0;
  // METIS takes its input through pointers to non-const, and leaves it as it is.
  auto input = [](const std::vector<std::int32_t>& v) { return const_cast<idx_t*>(v.data()); };
  part.assign(graph.size(), 0);
  const auto function = kind == Kind::kKway ? METIS_PartGraphKway : METIS_PartGraphRecursive;
  const std::lock_guard lock(metisMutex());
  return function(&size, &constraints, input(graph.row), input(graph.neighbors), input(graph.vertex_weights), nullptr,
                  input(graph.edge_weights), &parts, shares.empty() ? nullptr : shares.data(), nullptr, options.data(),
                  &cut, part.data()) == METIS_OK;
}

// The first vertices in order, up to `share` of the weight, against the rest; both sides get at least one.
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

class RecursiveBisection {
 public:
  RecursiveBisection(std::size_t size, std::int64_t max_weight) : part_(size, 0), max_weight_(max_weight) {}

  void run(const Graph& graph, const std::vector<std::uint32_t>& vertices) {
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
  std::vector<std::uint32_t> take() { return std::move(part_); }

 private:
  // Up to so many vertices METIS takes longer than bisect(), and cuts no better.
  static constexpr std::size_t kMostBisected = 1024;
  // 7 % of a part stay free for imbalance and for the grain of the vertices, so that few parts need one more cut.
  static constexpr double kFilled = 0.93;

  std::vector<std::int32_t> twoSides(const Graph& graph, std::int64_t weight) const {
    const double most = static_cast<double>(max_weight_);
    const double needed = std::max(2.0, std::ceil(static_cast<double>(weight) / (kFilled * most)));
    const double left = std::floor(needed / 2.0);
    if (graph.size() <= kMostBisected) {
      const auto whole = static_cast<double>(weight);
      BisectionTarget target;
      target.weight = std::llround(left / needed * whole);
      target.most = mostOfSide(left, left / needed * whole);
      target.least = weight - mostOfSide(needed - left, (needed - left) / needed * whole);
      return bisect(graph, target);
    }
    std::vector<float> shares{static_cast<float>(left / needed), static_cast<float>(1.0 - left / needed)};
    std::vector<std::int32_t> side;
    const bool done = callMetis(Kind::kRecursive, graph, 2, shares, side);
    const auto zeros = std::count(side.begin(), side.end(), 0);
    if (!done || zeros == 0 || zeros == static_cast<std::ptrdiff_t>(side.size()))
      splitByOrder(graph, left / needed, side);
    return side;
  }

  // What a side of so many parts may weigh: a single part may be full, several must not need one more. Between 2 % and
  // 10 % over its share.
  std::int64_t mostOfSide(double parts, double share) const {
    const double room = (parts > 1.0 ? kFilled : 1.0) * parts * static_cast<double>(max_weight_);
    return static_cast<std::int64_t>(std::clamp(room, 1.02 * share, 1.1 * share));
  }

  std::vector<std::uint32_t> part_;
  std::int64_t max_weight_;
  std::uint32_t next_part_ = 0;
};

std::uint32_t findRoot(std::vector<std::uint32_t>& parent, std::uint32_t v) {
  while (parent[v] != v) v = parent[v] = parent[parent[v]];
  return v;
}

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
  std::vector<KeyedIndex> order(edges.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = {edges[i].a * vertices + edges[i].b, i};
  radixSort(order, static_cast<std::uint32_t>(std::bit_width(vertices * vertices)));
  std::vector<WeightedEdge> merged;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (i > 0 && order[i].key == order[i - 1].key)
      merged.back().weight += edges[order[i].index].weight;
    else
      merged.push_back(edges[order[i].index]);
  }
  edges = std::move(merged);
  const std::size_t kept = edges.size();

  // Both directions, in rows.
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
  std::vector<std::uint32_t> parent(vertices);
  std::iota(parent.begin(), parent.end(), 0U);
  for (const WeightedEdge& e : edges) {
    const std::uint32_t a = findRoot(parent, e.a);
    const std::uint32_t b = findRoot(parent, e.b);
    parent[std::max(a, b)] = std::min(a, b);
  }
  for (std::uint32_t v = 0; v < vertices; ++v) parent[v] = findRoot(parent, v);
  return parent;
}

void tieComponents(std::span<const std::uint32_t> order, std::vector<WeightedEdge>& edges) {
  const std::vector<std::uint32_t> component = components(order.size(), edges);
  for (std::size_t i = 1; i < order.size(); ++i)
    if (component[order[i - 1]] != component[order[i]]) edges.push_back({order[i - 1], order[i], 1});
}

std::vector<std::uint32_t> partitionRecursively(const Graph& graph, std::int64_t max_weight) {
  RecursiveBisection bisection(graph.size(), max_weight);
  std::vector<std::uint32_t> all(graph.size());
  std::iota(all.begin(), all.end(), 0U);
  if (!all.empty()) bisection.run(graph, all);
  return bisection.take();
}

std::vector<std::uint32_t> partitionIntoParts(const Graph& graph, std::uint32_t parts) {
  if (parts <= 1 || graph.size() <= 1) return std::vector<std::uint32_t>(graph.size(), 0);
  std::vector<float> equal_shares;
  std::vector<std::int32_t> part;
  const Kind kind = parts > 8 ? Kind::kKway : Kind::kRecursive;
  if (!callMetis(kind, graph, static_cast<std::int32_t>(parts), equal_shares, part))
    for (std::size_t v = 0; v < part.size(); ++v) part[v] = static_cast<std::int32_t>(v * parts / part.size());
  return withoutGaps(part, parts);
}

}  // namespace lod::build
