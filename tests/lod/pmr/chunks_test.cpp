#include "lod/pmr/chunks.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

#include "tests/support/made_pmr.h"

namespace lod::pmr {
namespace {

constexpr std::int32_t kLast = (1 << kPositionBits) - 1;

std::vector<CodedPoint> randomPoints(std::size_t count, unsigned seed, std::int32_t low = 0,
                                     std::int32_t high = kLast) {
  std::mt19937 random(seed);
  const auto number = [&](std::int32_t from, std::int32_t to) {
    return from + static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(to - from + 1));
  };
  std::vector<CodedPoint> points(count);
  for (CodedPoint& point : points) {
    point.place = {number(low, high), number(low, high), number(low, high)};
    point.normal = glm::u8vec2(number(0, 255), number(0, 255));
    point.color = glm::u8vec3(number(0, 255), number(0, 255), number(0, 255));
  }
  sortForChunk(points);
  return points;
}

std::vector<CodedPoint> decoded(base::ByteView chunk, std::size_t own, std::size_t foreign, bool colors) {
  std::vector<CodedPoint> out;
  const auto result =
      decodePoints(chunk, static_cast<std::uint32_t>(own), static_cast<std::uint32_t>(foreign), colors, out);
  EXPECT_TRUE(result) << result.error().message;
  return out;
}

void expectPointsReturn(const std::vector<CodedPoint>& own, const std::vector<CodedPoint>& foreign) {
  std::vector<CodedPoint> all = own;
  all.insert(all.end(), foreign.begin(), foreign.end());
  EXPECT_EQ(decoded(encodePoints(own, foreign, true), own.size(), foreign.size(), true), all);
  for (CodedPoint& point : all) point.color = glm::u8vec3(255);
  EXPECT_EQ(decoded(encodePoints(own, foreign, false), own.size(), foreign.size(), false), all);
}

using TriangleSet = std::set<std::set<std::uint16_t>>;

TriangleSet setOf(const std::vector<std::uint16_t>& corners) {
  TriangleSet triangles;
  for (std::size_t i = 0; i < corners.size(); i += 3) triangles.insert({corners[i], corners[i + 1], corners[i + 2]});
  return triangles;
}

void expectTrianglesReturn(const std::vector<std::uint16_t>& corners, const std::vector<glm::ivec3>& places) {
  const base::Bytes chunk = encodeTriangles(corners, places);
  const auto back = decodeTriangles(chunk, static_cast<std::uint32_t>(corners.size() / 3), places);
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->size(), corners.size());
  EXPECT_EQ(setOf(*back), setOf(corners));
}

TEST(ChunksTest, normalsReturnWithinADegreeAndAsUnitVectors) {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (int i = 0; i < 2000; ++i) {
    const glm::vec3 n = glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
    const glm::vec3 back = decodeNormal(encodeNormal(n));
    EXPECT_NEAR(glm::length(back), 1.0F, 1e-5F);
    EXPECT_LT(glm::length(n - back), 0.015F) << n.x << ' ' << n.y << ' ' << n.z;
  }
  for (int x = 0; x < 256; ++x)
    for (int y = 0; y < 256; ++y) {
      const glm::vec3 n = decodeNormal(glm::u8vec2(x, y));
      ASSERT_LT(glm::length(n - decodeNormal(encodeNormal(n))), 1e-5F);
    }
}

TEST(ChunksTest, pointsReturn) {
  expectPointsReturn({}, {});
  expectPointsReturn(randomPoints(1, 1), {});
  expectPointsReturn({}, randomPoints(1, 2));
  expectPointsReturn(randomPoints(2, 3), randomPoints(3, 4));
  expectPointsReturn(randomPoints(kMaxLeafPoints, 5), randomPoints(2000, 6));
  expectPointsReturn(randomPoints(3000, 7, 1000, 1040), randomPoints(100, 8, 990, 1050));
  expectPointsReturn(randomPoints(500, 9, 77, 77), {});  // all at one place
  std::vector<CodedPoint> corners(8);
  for (int i = 0; i < 8; ++i)
    corners[static_cast<std::size_t>(i)].place = kLast * glm::ivec3(i & 1, i >> 1 & 1, i >> 2);
  sortForChunk(corners);
  expectPointsReturn(corners, corners);
}

TEST(ChunksTest, aDamagedChunkOfPointsIsRefusedAndLeavesTheListAlone) {
  const std::vector<CodedPoint> own = randomPoints(40, 1), foreign = randomPoints(5, 2);
  const base::Bytes chunk = encodePoints(own, foreign, true);
  std::vector<CodedPoint> out = randomPoints(3, 3);
  const std::vector<CodedPoint> before = out;
  const auto refused = [&](base::ByteView bytes, std::uint32_t o, std::uint32_t f) {
    const auto result = decodePoints(bytes, o, f, true, out);
    EXPECT_FALSE(result);
    EXPECT_EQ(out, before);
  };
  for (std::size_t length = 0; length < chunk.size(); ++length) refused(base::ByteView(chunk).first(length), 40, 5);
  for (std::size_t i = 0; i < chunk.size(); ++i) {
    base::Bytes spoilt = chunk;
    spoilt[i] ^= 0x10;
    refused(spoilt, 40, 5);
  }
  refused(chunk, 40, 6);
  refused(chunk, 39, 5);
  refused(chunk, 0, 0);
  refused({}, 1, 0);
  refused(chunk, 0xFFFFFFFF, 5);
}

TEST(ChunksTest, trianglesOfASurfaceReturnAtEachLevel) {
  const support::MadePmr made = support::madePmr(96, true, 700);
  ASSERT_GT(made.leaves.size(), 5U);
  for (std::size_t i = 0; i < made.leaves.size(); ++i) {
    std::vector<CodedPoint> points;
    for (std::uint32_t level = kLevels; level-- > 0;) {
      const Leaf& leaf = made.leaves[i];
      const LevelRow& row = leaf.levels[level];
      const auto partOf = [&](std::uint64_t offset, std::uint32_t bytes) {
        return base::ByteView(made.file).subspan(offset, bytes);
      };
      ASSERT_TRUE(decodePoints(partOf(row.point_offset, row.point_bytes), row.points, row.foreign, true, points));
      ASSERT_EQ(points.size(), leaf.verticesAt(level));
      std::vector<glm::ivec3> places;
      for (const CodedPoint& point : points) places.push_back(point.place);
      const auto corners = decodeTriangles(partOf(row.triangle_offset, row.triangle_bytes), row.triangles, places);
      ASSERT_TRUE(corners);
      EXPECT_EQ(setOf(*corners), setOf(made.contents[i].corners[level]));
    }
    EXPECT_EQ(points, made.contents[i].vertices);
  }
}

TEST(ChunksTest, anyTrianglesReturn) {
  std::vector<glm::ivec3> places;
  for (const CodedPoint& point : randomPoints(60, 4)) places.push_back(point.place);
  places.insert(places.end(), 5, glm::ivec3(5));  // several at one place
  expectTrianglesReturn({}, places);
  expectTrianglesReturn({3, 1, 2}, places);
  std::mt19937 random(9);
  for (const std::size_t count : {10U, 100U, 1000U, 20'000U}) {
    TriangleSet triangles;
    for (std::size_t i = 0; i < count; ++i) {
      const auto corner = [&] { return static_cast<std::uint16_t>(random() % places.size()); };
      const std::set<std::uint16_t> triangle{corner(), corner(), corner()};
      if (triangle.size() == 3) triangles.insert(triangle);
    }
    std::vector<std::uint16_t> corners;
    for (const auto& triangle : triangles) corners.insert(corners.end(), triangle.begin(), triangle.end());
    expectTrianglesReturn(corners, places);
  }
}

// Few triangles that cover all edges of a complete graph: its cliques are many more, so the list is coded.
TEST(ChunksTest, trianglesThatAreFewAmongManyCliquesReturn) {
  std::vector<glm::ivec3> places;
  for (const CodedPoint& point : randomPoints(120, 4)) places.push_back(point.place);
  std::vector<std::uint16_t> corners;
  std::set<std::pair<int, int>> covered;
  for (int a = 0; a < 120; ++a)
    for (int b = a + 1; b < 120; ++b)
      for (int c = b + 1; c < 120 && covered.count({a, b}) == 0; ++c) {
        if (covered.count({a, c}) + covered.count({b, c}) > 0) continue;
        for (const auto& edge : {std::pair(a, b), std::pair(a, c), std::pair(b, c)}) covered.insert(edge);
        for (const int corner : {a, b, c}) corners.push_back(static_cast<std::uint16_t>(corner));
      }
  expectTrianglesReturn(corners, places);
}

TEST(ChunksTest, aDamagedChunkOfTrianglesIsRefused) {
  std::vector<glm::ivec3> places;
  for (const CodedPoint& point : randomPoints(30, 4)) places.push_back(point.place);
  std::vector<std::uint16_t> corners;
  for (std::uint16_t v = 0; v + 2 < 30; ++v)
    corners.insert(corners.end(), {v, std::uint16_t(v + 1), std::uint16_t(v + 2)});
  const base::Bytes chunk = encodeTriangles(corners, places);
  for (std::size_t length = 0; length < chunk.size(); ++length)
    EXPECT_FALSE(decodeTriangles(base::ByteView(chunk).first(length), 28, places));
  for (std::size_t i = 0; i < chunk.size(); ++i) {
    base::Bytes spoilt = chunk;
    spoilt[i] ^= 1;
    EXPECT_FALSE(decodeTriangles(spoilt, 28, places));
  }
  EXPECT_FALSE(decodeTriangles(chunk, 27, places));
  EXPECT_FALSE(decodeTriangles(chunk, 0, places));
  EXPECT_FALSE(decodeTriangles(chunk, 0xFFFFFFFF, places));
  EXPECT_FALSE(decodeTriangles(chunk, 28, std::span(places).first(29)));
  EXPECT_FALSE(decodeTriangles({}, 28, places));
}

}  // namespace
}  // namespace lod::pmr
