#pragma once
// Cutting small graphs in two: one side grows from a vertex far out (graph growing), then vertices change sides while
// that shortens the cut (Fiduccia, Mattheyses 1982), from several starts. Up to a few hundred vertices that finds cuts
// as short as multilevel methods do, in less time, and asks no random numbers.
#include <cstdint>
#include <vector>

#include "lod/patch/builder/partition.h"

namespace lod::patch::builder {

/// What side 0 should weigh, and may; in vertex weights of the graph.
struct BisectionTarget {
  std::int64_t weight = 0;  ///< between 0 and the graph's
  std::int64_t least = 0;
  std::int64_t most = 0;
};
/// The side of each vertex, 0 or 1, both in use; outside least … most only where the grain of the vertices allows no
/// better. `graph`: two vertices or more. Depends on the graph alone.
std::vector<std::int32_t> bisect(const Graph& graph, const BisectionTarget& target);

}  // namespace lod::patch::builder
