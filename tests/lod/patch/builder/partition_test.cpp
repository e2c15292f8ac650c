#include "lod/patch/builder/partition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <thread>

#include "tests/lod/patch/builder/grid_graph.h"

namespace {

using namespace lod::patch::builder;

std::vector<std::int64_t> weights(const Graph& graph, const std::vector<std::uint32_t>& part) {
  std::vector<std::int64_t> sums(*std::max_element(part.begin(), part.end()) + 1, 0);
  for (std::size_t v = 0; v < part.size(); ++v) sums[part[v]] += graph.vertex_weights[v];
  return sums;
}

TEST(Partition, graphSumsEqualEdgesAndDropsLoops) {
  const Graph graph = graphFromEdges({1, 1, 1}, {{0, 1, 2}, {1, 0, 3}, {2, 2, 9}, {1, 2, 1}});
  EXPECT_EQ(graph.row, (std::vector<std::int32_t>{0, 1, 3, 4}));
  EXPECT_EQ(graph.neighbors, (std::vector<std::int32_t>{1, 0, 2, 1}));
  EXPECT_EQ(graph.edge_weights, (std::vector<std::int32_t>{5, 5, 1, 1}));
}

TEST(Partition, recursivePartsStayUnderTheLimitAndAreNotTiny) {
  const Graph graph = support::gridGraph(40, 30);
  const auto part = partitionRecursively(graph, 1000);
  const auto sums = weights(graph, part);
  for (const std::int64_t sum : sums) {
    EXPECT_LE(sum, 1000);
    EXPECT_GE(sum, 300);
  }
  EXPECT_LE(sums.size(), 16U);
}

TEST(Partition, aSingleHeavyVertexStaysWhole) {
  const Graph graph = graphFromEdges({5000, 1, 1}, {{0, 1, 1}, {1, 2, 1}});
  const auto part = partitionRecursively(graph, 100);
  EXPECT_NE(part[0], part[1]);
  EXPECT_EQ(weights(graph, part)[part[0]], 5000);
}

TEST(Partition, graphWithoutEdgesIsSplitToo) {
  const Graph graph = graphFromEdges(std::vector<std::int32_t>(100, 1), {});
  for (const std::int64_t sum : weights(graph, partitionRecursively(graph, 10))) EXPECT_LE(sum, 10);
}

// A large component, and far from it two small ones that lie beside each other.
TEST(Partition, smallPiecesShareAPartOnlyWithWhatIsNear) {
  const auto extentAt = [](double x, double y) { return Extent{{x, y, 0.0}, {x + 1.0, y + 1.0, 0.0}}; };
  std::vector<WeightedEdge> edges;
  std::vector<Extent> extents;
  for (std::uint32_t i = 0; i < 400; ++i) {
    extents.push_back(extentAt(i % 20, i / 20));
    if (i % 20 != 0) edges.push_back({i - 1, i, 1});
    if (i >= 20) edges.push_back({i - 20, i, 1});
  }
  for (const double x : {10.0, 60.0, 62.0}) extents.push_back(extentAt(x, x > 20.0 ? 10.0 : 60.0));
  const Graph graph = graphFromEdges(std::vector<std::int32_t>(403, 10), edges);
  const auto part = partitionRecursively(graph, 100, extents);
  EXPECT_EQ(part[401], part[402]);
  EXPECT_NE(part[400], part[401]);
  for (std::uint32_t i = 0; i < 400; ++i) EXPECT_TRUE(part[i] != part[400] && part[i] != part[401]) << i;
  // Without extents the small components share a part.
  const auto blind = partitionRecursively(graph, 100);
  EXPECT_EQ(blind[400], blind[401]);
}

TEST(Partition, dustIsGatheredIntoPartsOfItsNeighborhood) {
  std::vector<Extent> extents;
  for (std::uint32_t i = 0; i < 1600; ++i) {
    const glm::dvec3 at(i % 40, i / 40, 0.0);
    extents.push_back({at, at + 0.01});
  }
  const Graph graph = graphFromEdges(std::vector<std::int32_t>(1600, 1), {});
  const auto part = partitionRecursively(graph, 100, extents);
  const auto sums = weights(graph, part);
  EXPECT_LE(sums.size(), 60U);  // 16 full ones at least
  std::vector<Extent> boxes(sums.size());
  for (std::uint32_t i = 0; i < 1600; ++i) boxes[part[i]].add(extents[i]);
  for (const Extent& box : boxes) EXPECT_LE(box.diagonal(), 2.0 * 40.0 * std::sqrt(2.0) / 4.0);
}

TEST(Partition, partsAreNumberedWithoutGaps) {
  const Graph graph = support::gridGraph(20, 20);
  const auto part = partitionIntoParts(graph, 50);
  for (const std::int64_t sum : weights(graph, part)) EXPECT_GT(sum, 0);
}

TEST(Partition, tiesMakeOneComponent) {
  std::vector<WeightedEdge> edges{{0, 1, 4}, {2, 3, 4}};
  const std::vector<std::uint32_t> order{0, 1, 2, 3, 4};
  tieComponents(order, edges);
  for (const std::uint32_t c : components(5, edges)) EXPECT_EQ(c, 0U);
  EXPECT_EQ(edges.size(), 4U);
}

// METIS has one random state for the whole process; calls that run at once must not change each other's result.
TEST(Partition, resultsDoNotDependOnWhatRunsBesideThem) {
  const Graph graph = support::gridGraph(37, 23);
  const auto alone = partitionIntoParts(graph, 12);
  std::vector<std::thread> threads;
  std::vector<std::vector<std::uint32_t>> results(6);
  for (std::size_t t = 0; t < results.size(); ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 5; ++i) (void)partitionRecursively(graph, 300 + static_cast<std::int64_t>(t));
      results[t] = partitionIntoParts(graph, 12);
    });
  for (std::thread& t : threads) t.join();
  for (const auto& result : results) EXPECT_EQ(result, alone);
}

}  // namespace
