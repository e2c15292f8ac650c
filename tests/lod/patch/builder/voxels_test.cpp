#include "lod/patch/builder/voxels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

#include "lod/patch/builder/patch_split.h"
#include "tests/support/mesh_reader.h"

namespace {

using namespace lod::ingest;
using namespace lod::patch::builder;
using support::makeSample;
using support::Mesh;
using namespace mesh::generate;

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
// What a bucket holds: a range of the Morton curve, which leaves and enters the surface here and there.
TEST(Voxels, PartsOfABucketSpanNoPiecesFarApart) {
  constexpr std::uint32_t kBits = 12;
  mesh::generate::SampleOptions options;
  options.triangles = 100'000;
  const Mesh statue = makeSample(options);
  base::Aabb whole;
  for (const glm::vec3& p : statue.positions) whole.add(p);
  const glm::vec3 size = whole.max - whole.min;
  const float scale = static_cast<float>((1 << kBits) - 1) / std::max({size.x, size.y, size.z});
  CodedMesh mesh;
  for (const glm::vec3& p : statue.positions) {
    mesh.positions.push_back(glm::ivec3(scale * (p - whole.min)));
    mesh.codes.push_back(mortonCode(mesh.positions.back()));
  }
  mesh.indices = statue.indices;
  const std::vector<KeyedIndex> sorted = sortedByVoxel(mesh, kBits);
  constexpr std::uint32_t kMax = 300;
  const double share = std::sqrt(static_cast<double>(kMax) / static_cast<double>(sorted.size()));
  const auto widthOf = [&](const std::vector<std::uint32_t>& triangles) {
    Extent box;
    for (const std::uint32_t t : triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const glm::dvec3 q(mesh.positions[mesh.indices[3 * std::size_t{t} + k]]);
        box.add({q, q});
      }
    return box.diagonal();
  };
  std::size_t parts = 0;
  double widest = 0.0;
  for (std::size_t first = 0; first < sorted.size(); first += sorted.size() / 9) {
    const auto bucket = std::span(sorted).subspan(first, std::min(sorted.size() / 9, sorted.size() - first));
    std::vector<KeyedIndex> own(bucket.begin(), bucket.end());
    const auto split = splitTriangles(mesh, own, kBits, 8, kMax, TieWeight::kNormals);
    std::size_t triangles = 0;
    for (const auto& part : split) {
      EXPECT_LE(part.size(), kMax);
      triangles += part.size();
      widest = std::max(widest, widthOf(part));
    }
    EXPECT_EQ(triangles, own.size());
    parts += split.size();
  }
  EXPECT_LE(parts, 500U);  // 334 full ones
  // Parts of one piece may be longer than their share of the surface says.
  std::vector<std::uint32_t> all(sorted.size());
  std::iota(all.begin(), all.end(), 0U);
  EXPECT_LE(widest, 5.0 * share * widthOf(all));
}

}  // namespace
