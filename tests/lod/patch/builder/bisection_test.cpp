#include "lod/patch/builder/partition.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/lod/patch/builder/grid_graph.h"

namespace {

using namespace lod::patch::builder;

std::int64_t weightOf(const Graph& graph, const std::vector<std::int32_t>& side, std::int32_t s) {
  std::int64_t sum = 0;
  for (std::size_t v = 0; v < side.size(); ++v) sum += side[v] == s ? graph.vertex_weights[v] : 0;
  return sum;
}

std::int64_t cutOf(const Graph& graph, const std::vector<std::int32_t>& side) {
  std::int64_t twice = 0;
  for (std::size_t v = 0; v < side.size(); ++v)
    for (auto e = static_cast<std::size_t>(graph.row[v]); e < static_cast<std::size_t>(graph.row[v + 1]); ++e)
      twice += side[v] != side[static_cast<std::size_t>(graph.neighbors[e])] ? graph.edge_weights[e] : 0;
  return twice / 2;
}

TEST(Bisection, aGridIsCutAcrossItsShorterExtent) {
  const Graph graph = support::gridGraph(20, 6, 2);
  const auto side = bisect(graph, {600, 588, 612});
  EXPECT_EQ(weightOf(graph, side, 0), 600);
  EXPECT_EQ(cutOf(graph, side), 2 * 6);
}

TEST(Bisection, sidesHaveTheSharesAskedFor) {
  const Graph graph = support::gridGraph(15, 10, 2);
  for (const std::int64_t target : {300, 500, 750}) {
    const auto side = bisect(graph, {target, target - 20, target + 20});
    EXPECT_GE(weightOf(graph, side, 0), target - 20);
    EXPECT_LE(weightOf(graph, side, 0), target + 20);
    EXPECT_LE(cutOf(graph, side), 2 * 13);
  }
}

// The graph has two cliques of eight, one edge between them, and vertices numbered alternately.
TEST(Bisection, theOneBridgeIsFound) {
  std::vector<WeightedEdge> edges{{0, 1, 3}};
  for (std::uint32_t a = 0; a < 16; ++a)
    for (std::uint32_t b = a + 2; b < 16; b += 2) edges.push_back({a, b, 5});
  const Graph graph = graphFromEdges(std::vector<std::int32_t>(16, 1), edges);
  const auto side = bisect(graph, {8, 7, 9});
  EXPECT_EQ(cutOf(graph, side), 3);
}

TEST(Bisection, bothSidesAreInUseWhateverTheGraph) {
  const Graph pair = graphFromEdges({7, 1}, {{0, 1, 1}});
  const Graph heavy = graphFromEdges({5000, 1, 1}, {{0, 1, 1}, {1, 2, 1}});
  const Graph loose = graphFromEdges(std::vector<std::int32_t>(9, 1), {});
  for (const Graph* graph : {&pair, &heavy, &loose})
    for (const std::int64_t target : {std::int64_t{0}, std::int64_t{1}, std::int64_t{4}, std::int64_t{5002}}) {
      const auto side = bisect(*graph, {target, target - 1, target + 1});
      EXPECT_GT(std::count(side.begin(), side.end(), 0), 0) << target;
      EXPECT_GT(std::count(side.begin(), side.end(), 1), 0) << target;
    }
}

}  // namespace
