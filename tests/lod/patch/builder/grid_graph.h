#pragma once
// Graphs of grids, whose best cuts are known.
#include <cstdint>
#include <vector>

#include "lod/patch/builder/partition.h"

namespace support {

/// Returns a grid of w × h vertices of weight 10, with edges of weight `edge_weight` between neighbours.
inline lod::patch::builder::Graph gridGraph(std::uint32_t w, std::uint32_t h, std::int32_t edge_weight = 1) {
  std::vector<lod::patch::builder::WeightedEdge> edges;
  for (std::uint32_t y = 0; y < h; ++y)
    for (std::uint32_t x = 0; x < w; ++x) {
      if (x + 1 < w) edges.push_back({y * w + x, y * w + x + 1, edge_weight});
      if (y + 1 < h) edges.push_back({y * w + x, (y + 1) * w + x, edge_weight});
    }
  return lod::patch::builder::graphFromEdges(std::vector<std::int32_t>(std::size_t{w} * h, 10), edges);
}

}  // namespace support
