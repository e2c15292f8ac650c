#include "lod/build/voxels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace {

using namespace lod::build;

TEST(Voxels, MortonCodesComeBack) {
  for (const glm::ivec3& q : {glm::ivec3(0), glm::ivec3(1, 2, 3), glm::ivec3(2097151, 0, 1234567), glm::ivec3(2097151)})
    EXPECT_EQ(mortonPoint(mortonCode(q)), q);
  EXPECT_EQ(mortonCode({1, 0, 0}), 1U);
  EXPECT_EQ(mortonCode({0, 1, 0}), 2U);
  EXPECT_EQ(mortonCode({0, 0, 1}), 4U);
}

// At every depth, the cell of the median code holds at least as many of the three vertices as any other cell.
TEST(Voxels, MedianCodeNamesTheCellWithMostVerticesAtEveryDepth) {
  std::mt19937 random(1);
  for (int i = 0; i < 2000; ++i) {
    std::array<std::uint64_t, 3> codes;
    for (auto& c : codes)
      c = mortonCode(
          {static_cast<int>(random() % 64), static_cast<int>(random() % 64), static_cast<int>(random() % 64)});
    const std::uint64_t median = medianCode(codes[0], codes[1], codes[2]);
    for (std::uint32_t size_bits = 0; size_bits <= 6; ++size_bits) {
      auto held = [&](std::uint64_t code) {
        return std::count_if(codes.begin(), codes.end(),
                             [&](std::uint64_t c) { return c >> (3 * size_bits) == code >> (3 * size_bits); });
      };
      const auto most = std::max({held(codes[0]), held(codes[1]), held(codes[2])});
      ASSERT_EQ(held(median), most);
    }
  }
}

TEST(Voxels, RadixSortIsStableAndSorted) {
  std::mt19937 random(2);
  std::vector<KeyedIndex> items;
  for (std::uint32_t i = 0; i < 5000; ++i) items.push_back({random() % 700, i});
  radixSort(items, 12);
  for (std::size_t i = 1; i < items.size(); ++i) {
    ASSERT_LE(items[i - 1].key, items[i].key);
    if (items[i - 1].key == items[i].key) {
      ASSERT_LT(items[i - 1].index, items[i].index);
    }
  }
}

TEST(Voxels, AreSubdividedUntilTheyHoldFewEnough) {
  std::mt19937 random(3);
  std::vector<KeyedIndex> sorted;
  for (std::uint32_t i = 0; i < 3000; ++i)
    sorted.push_back({mortonCode({static_cast<int>(random() % 256), static_cast<int>(random() % 64), 5}), i});
  radixSort(sorted, 24);
  const auto voxels = makeVoxels(sorted, 8, 50);
  std::size_t next = 0;
  for (const Voxel& v : voxels) {
    EXPECT_EQ(v.first, next);
    EXPECT_LE(v.count, 50U);
    for (std::uint32_t i = v.first; i < v.first + v.count; ++i)
      EXPECT_EQ(sorted[i].key >> (3 * v.size_bits) << (3 * v.size_bits), v.code);
    next += v.count;
  }
  EXPECT_EQ(next, sorted.size());
}

TEST(Voxels, AStackOnOneLatticePointStaysOneVoxel) {
  std::vector<KeyedIndex> sorted;
  for (std::uint32_t i = 0; i < 900; ++i) sorted.push_back({77, i});
  const auto voxels = makeVoxels(sorted, 10, 500);
  ASSERT_EQ(voxels.size(), 1U);
  EXPECT_EQ(voxels[0].count, 900U);
}

// Two triangles far apart share nothing; the graph ties them all the same, so that METIS sees one piece.
TEST(Voxels, GraphIsConnectedWhateverTheMesh) {
  std::vector<glm::ivec3> positions;
  std::vector<std::uint32_t> indices;
  for (int i = 0; i < 20; ++i) {
    const glm::ivec3 at(50 * i, (37 * i) % 1000, (91 * i) % 1000);
    for (const glm::ivec3& d : {glm::ivec3(0), glm::ivec3(1, 0, 0), glm::ivec3(0, 1, 0)})
      indices.push_back(static_cast<std::uint32_t>(positions.size())), positions.push_back(at + d);
  }
  std::vector<KeyedIndex> sorted;
  for (std::uint32_t t = 0; t < 20; ++t) sorted.push_back({mortonCode(positions[3 * t]), t});
  radixSort(sorted, 30);
  const auto voxels = makeVoxels(sorted, 10, 1);
  const Graph graph = voxelGraph({positions, indices}, sorted, voxels, 10, TieWeight::kNormals);
  std::vector<WeightedEdge> edges;
  for (std::uint32_t v = 0; v < graph.size(); ++v)
    for (auto e = graph.row[v]; e < graph.row[v + 1]; ++e)
      edges.push_back({v, static_cast<std::uint32_t>(graph.neighbors[static_cast<std::size_t>(e)]), 1});
  for (const std::uint32_t c : components(graph.size(), edges)) EXPECT_EQ(c, 0U);
}

}  // namespace
