#pragma once
// Cuts small graphs in two: one side grows from a vertex far out (graph growing), then vertices change sides while that
// shortens the cut (Fiduccia and Mattheyses 1982, "A Linear-Time Heuristic for Improving Network Partitions"), from
// several starts. Up to a few hundred vertices this finds cuts as short as multilevel methods do, in less time, and
// needs no random numbers.
#include <cstdint>
#include <vector>

#include "lod/patch/builder/partition.h"

namespace lod::patch::builder {

/// The wanted weight of side 0 and its limits, in vertex weights of the graph.
struct BisectionTarget {
  std::int64_t weight = 0;  ///< between 0 and the graph's
  std::int64_t min = 0;
  std::int64_t max = 0;
};
/// The side of each vertex, 0 or 1, both in use. The weight is outside min … max only where the vertices are too heavy
/// for better. `graph`: two vertices or more. The result depends on the graph alone.
std::vector<std::int32_t> bisect(const Graph& graph, const BisectionTarget& target);

}  // namespace lod::patch::builder
