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

TEST(Voxels, mortonCodesComeBack) {
  for (const glm::ivec3& q : {glm::ivec3(0), glm::ivec3(1, 2, 3), glm::ivec3(2097151, 0, 1234567), glm::ivec3(2097151)})
    EXPECT_EQ(mortonPoint(mortonCode(q)), q);
  EXPECT_EQ(mortonCode({1, 0, 0}), 1U);
  EXPECT_EQ(mortonCode({0, 1, 0}), 2U);
  EXPECT_EQ(mortonCode({0, 0, 1}), 4U);
}

// At every depth, the cell of the median code holds at least as many of the three vertices as any other cell.
TEST(Voxels, medianCodeNamesTheCellWithMostVerticesAtEveryDepth) {
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

TEST(Voxels, radixSortIsStableAndSorted) {
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

TEST(Voxels, areSubdividedUntilTheyHoldFewEnough) {
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

TEST(Voxels, aStackOnOneLatticePointStaysOneVoxel) {
  std::vector<KeyedIndex> sorted;
  for (std::uint32_t i = 0; i < 900; ++i) sorted.push_back({77, i});
  const auto voxels = makeVoxels(sorted, 10, 500);
  ASSERT_EQ(voxels.size(), 1U);
  EXPECT_EQ(voxels[0].count, 900U);
}

// A floor and a wall of 16 × 48 squares that meet at a crease of 48: cutting across the crease is shorter, but
// separates triangles of one plane, whose ties by normals weigh 16.
CodedMesh foldedSheet() {
  constexpr int kWidth = 16;
  constexpr int kLength = 48;
  CodedMesh mesh;
  for (int y = 0; y <= kLength; ++y)
    for (int i = 0; i <= 2 * kWidth; ++i) {
      mesh.positions.emplace_back(std::min(i, kWidth), y, std::max(0, i - kWidth));
      mesh.codes.push_back(mortonCode(mesh.positions.back()));
    }
  constexpr std::uint32_t kRow = 2 * kWidth + 1;
  for (std::uint32_t y = 0; y < kLength; ++y)
    for (std::uint32_t i = 0; i < 2 * kWidth; ++i) {
      const std::uint32_t a = y * kRow + i;
      mesh.indices.insert(mesh.indices.end(), {a, a + 1, a + kRow + 1, a, a + kRow + 1, a + kRow});
    }
  return mesh;
}

// The share of each part's triangles that lie in its main plane.
std::vector<double> planarShares(TieWeight weight) {
  constexpr std::uint32_t kBits = 6;
  const CodedMesh mesh = foldedSheet();
  const std::vector<KeyedIndex> sorted = sortedByVoxel(mesh, kBits);
  std::vector<double> shares;
  for (const auto& part : splitTriangles(mesh, sorted, kBits, 8, 1700, weight)) {
    const auto floor = std::count_if(part.begin(), part.end(), [&](std::uint32_t t) {
      const auto height = [&](std::size_t k) { return mesh.positions[mesh.indices[3 * std::size_t{t} + k]].z; };
      return height(0) == 0 && height(1) == 0 && height(2) == 0;
    });
    const double share = static_cast<double>(floor) / static_cast<double>(part.size());
    shares.push_back(std::max(share, 1.0 - share));
  }
  return shares;
}

TEST(Voxels, tiesByNormalsKeepPlanesTogetherWhereSharedVerticesCutThem) {
  const std::vector<double> by_normals = planarShares(TieWeight::kNormals);
  ASSERT_EQ(by_normals.size(), 2U);
  for (const double share : by_normals) EXPECT_GT(share, 0.9);
  const std::vector<double> by_vertices = planarShares(TieWeight::kSharedVertices);
  ASSERT_EQ(by_vertices.size(), 2U);
  for (const double share : by_vertices) EXPECT_LT(share, 0.7);
}

// A bucket is a range of the Morton curve, which leaves and enters the surface here and there.
TEST(Voxels, partsOfABucketSpanNoPiecesFarApart) {
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
    lod::patch::builder::Extent box;
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
  // A part of one component may be longer than its share of the surface.
  std::vector<std::uint32_t> all(sorted.size());
  std::iota(all.begin(), all.end(), 0U);
  EXPECT_LE(widest, 5.0 * share * widthOf(all));
}

}  // namespace
