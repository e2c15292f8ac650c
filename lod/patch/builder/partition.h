#pragma once
// Partitions graphs: large ones by METIS (Karypis and Kumar 1998, "A Fast and High Quality Multilevel Scheme for
// Partitioning Irregular Graphs"), small ones by a bisection of our own.
//
// METIS 5.1 draws from the C library's one random state. So every call of it takes one lock and starts from a fixed
// seed: results depend on the graph alone, whatever other threads do.
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <vector>

namespace lod::patch::builder {

/// An undirected graph with weights, in compressed rows: the neighbours of v are neighbors[row[v]] … neighbors[row[v +
/// 1] − 1].
struct Graph {
  std::vector<std::int32_t> row{0};
  std::vector<std::int32_t> neighbors;
  std::vector<std::int32_t> edge_weights;    ///< > 0, beside neighbors
  std::vector<std::int32_t> vertex_weights;  ///< > 0

  std::size_t size() const { return vertex_weights.size(); }
};

struct WeightedEdge {
  std::uint32_t a = 0;
  std::uint32_t b = 0;
  std::int32_t weight = 0;
};
/// Sums the weights of equal pairs (either order); drops loops.
Graph graphFromEdges(std::vector<std::int32_t> vertex_weights, std::vector<WeightedEdge> edges);

/// Components of the graph: the component number of each vertex, numbered by first vertex.
std::vector<std::uint32_t> components(std::size_t vertices, std::span<const WeightedEdge> edges);
/// Adds edges of weight 1 between neighbours in `order` that lie in different components, which connects the graph.
void tieComponents(std::span<const std::uint32_t> order, std::vector<WeightedEdge>& edges);

/// The box a vertex of a graph stands for.
struct Extent {
  glm::dvec3 low{std::numeric_limits<double>::infinity()};
  glm::dvec3 high{-std::numeric_limits<double>::infinity()};

  void add(const Extent& other) {
    low = glm::min(low, other.low);
    high = glm::max(high, other.high);
  }
  /// 0 while nothing was added.
  double diagonal() const { return low.x <= high.x ? glm::length(high - low) : 0.0; }
};

/// The wanted weight of side 0 and its limits, in vertex weights of the graph.
struct BisectionTarget {
  std::int64_t weight = 0;  ///< between 0 and the graph's
  std::int64_t min = 0;
  std::int64_t max = 0;
};
/// The side of each vertex, 0 or 1, both in use. The weight is outside min … max only where the vertices are too heavy
/// for better. `graph`: two vertices or more. The result depends on the graph alone.
std::vector<std::int32_t> bisect(const Graph& graph, const BisectionTarget& target);

/// Bisects recursively (in the ratio of the parts still needed on each side) until no part weighs more than
/// `max_weight`, unless it is a single vertex. Each component is cut on its own. Small components share parts if their
/// `extents` (one per vertex, or none) lie near each other: a shared part is at most twice as wide as a part of one
/// surface would be, 2 D √(max_weight / weight) for a whole of diagonal D. Returns the part of each vertex, numbered
/// 0, 1, … without gaps in order of the recursion.
std::vector<std::uint32_t> partitionRecursively(const Graph& graph, std::int64_t max_weight,
                                                std::span<const Extent> extents = {});

/// About `parts` parts of equal weight (parts ≥ 1), numbered without gaps. Parts may come out empty and are then left
/// out.
std::vector<std::uint32_t> partitionIntoParts(const Graph& graph, std::uint32_t parts);

}  // namespace lod::patch::builder
