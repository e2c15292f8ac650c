#include "plan/sight_cache.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>
#include <vector>

#include "plan/point_choice.h"
#include "repository/sampling/grid.h"

namespace plan {
namespace {

constexpr float kClearance = 0.05F;

/// Hills of 48 × 48 squares over [−4, 4]², in which valleys see little.
lod::patch::ProxySight hills() {
  constexpr int kSide = 48;
  lod::patch::Hierarchy hierarchy;
  hierarchy.lattice = {glm::dvec3(-4.0, -4.0, 0.0), 8.0 / (kSide * 16)};
  lod::patch::PatchGeometry g;
  for (int y = 0; y <= kSide; ++y)
    for (int x = 0; x <= kSide; ++x)
      g.positions.emplace_back(16 * x, 16 * y, static_cast<int>(60.0 * std::sin(0.5 * x) * std::cos(0.4 * y)));
  for (std::uint32_t y = 0; y < kSide; ++y)
    for (std::uint32_t x = 0; x < kSide; ++x) {
      const std::uint32_t i = y * (kSide + 1) + x, above = i + kSide + 1;
      for (const std::uint32_t corner : {i, i + 1, above + 1, i, above + 1, above}) g.indices.push_back(corner);
    }
  const std::vector<std::uint32_t> patches{0};
  return *lod::patch::ProxySight::ofPatches(
      hierarchy, patches, 2.0F * kClearance,
      [&](std::uint32_t) -> base::Result<lod::patch::PatchGeometry> { return g; });
}

repository::Grid gridOver() {
  repository::Grid grid;
  grid.first = glm::vec3(-4.0F, -4.0F, 0.2F);
  grid.spacing = 1.0F;
  grid.count = glm::uvec3(9, 9, 3);
  grid.face_size = 512;
  return grid;
}

glm::vec3 placeOf(const glm::uvec3& point) {
  return gridOver().point(point.x, point.y, point.z);
}

/// Asks cell by cell.
std::vector<bool> seenFrom(SightCache& cache, const lod::patch::ProxySight& sight, const glm::uvec3& point) {
  const auto row = cache.rowOf(point);
  std::vector<bool> seen;
  for (std::uint32_t cell = 0; cell < sight.cellCount(); ++cell) seen.push_back(cache.sees(*row, placeOf(point), cell));
  return seen;
}

std::vector<bool> expectedFrom(const lod::patch::ProxySight& sight, const glm::uvec3& point) {
  std::vector<bool> seen;
  for (std::uint32_t cell = 0; cell < sight.cellCount(); ++cell)
    seen.push_back(!sight.isBlocked(sight.cell(cell).place, placeOf(point), kClearance));
  return seen;
}

TEST(SightCache, saysTheSameEveryTime) {
  const lod::patch::ProxySight sight = hills();
  SightCache cache(sight, kClearance);
  std::size_t seen = 0, all = 0;
  for (std::uint32_t x = 0; x < 9; ++x) {
    const glm::uvec3 point(x, 4, x % 3);
    const auto expected = expectedFrom(sight, point);
    EXPECT_EQ(seenFrom(cache, sight, point), expected) << "computed";
    EXPECT_EQ(seenFrom(cache, sight, point), expected) << "remembered";
    seen += static_cast<std::size_t>(std::count(expected.begin(), expected.end(), true));
    all += expected.size();
  }
  EXPECT_GT(seen, all / 10);
  EXPECT_LT(seen, all - all / 10);
}

TEST(SightCache, keepsToItsBytes) {
  const lod::patch::ProxySight sight = hills();
  const std::uint64_t row = SightCache::Row(sight.cellCount()).bytes();
  SightCache cache(sight, kClearance, 3 * row);
  const auto kept = cache.rowOf({0, 0, 0});
  for (std::uint32_t y = 0; y < 9; ++y)
    for (std::uint32_t x = 0; x < 9; ++x) {
      cache.rowOf({x, y, 0});
      EXPECT_LE(cache.bytes(), 3 * row);
    }
  EXPECT_GE(cache.bytes(), 2 * row);
  EXPECT_NE(cache.rowOf({0, 0, 0}), kept) << "it was forgotten, and is made anew";
  EXPECT_EQ(seenFrom(cache, sight, {0, 0, 0}), expectedFrom(sight, {0, 0, 0}));
  EXPECT_EQ(cache.sees(*kept, placeOf({0, 0, 0}), 5), expectedFrom(sight, {0, 0, 0})[5]) << "who has it may use it";
}

TEST(SightCache, threadsAgree) {
  const lod::patch::ProxySight sight = hills();
  SightCache cache(sight, kClearance, 4 * SightCache::Row(sight.cellCount()).bytes());
  constexpr std::uint32_t kThreads = 4;
  std::vector<std::vector<std::vector<bool>>> answers(kThreads);
  std::vector<std::thread> threads;
  for (std::uint32_t t = 0; t < kThreads; ++t)
    threads.emplace_back([&, t] {
      for (std::uint32_t x = 0; x < 9; ++x) answers[t].push_back(seenFrom(cache, sight, {(x + t) % 9, 3, 1}));
    });
  for (std::thread& thread : threads) thread.join();
  for (std::uint32_t t = 0; t < kThreads; ++t)
    for (std::uint32_t x = 0; x < 9; ++x) EXPECT_EQ(answers[t][x], expectedFrom(sight, {(x + t) % 9, 3, 1}));
}

TEST(SightCache, isAskedForCellsThatLookSmallOnly) {
  const lod::patch::ProxySight sight = hills();
  SightCache cache(sight, kClearance);
  PointQuery query;
  query.grid = gridOver();
  query.sight = &sight;
  query.sight_cache = &cache;
  std::size_t near = 0, differing = 0, far = 0;
  for (const float height : {0.3F, 30.0F}) {
    query.eye = glm::vec3(0.1F, 0.2F, height);
    for (std::uint32_t x = 0; x < 9; ++x) {
      const glm::uvec3 point(x, 4, 1);
      const SightOfPoint of_point(query, point);
      const auto row = cache.rowOf(point);
      for (int i = 0; i < 400; ++i) {
        const glm::vec3 above(0.37F * static_cast<float>(i % 20) - 3.6F, 0.37F * static_cast<float>(i / 20) - 3.6F,
                              5.0F);
        const auto hit = sight.nearest(above, glm::vec3(0.0F, 0.0F, -1.0F), 100.0F);
        if (!hit) continue;
        SurfaceSample sample{above - glm::vec3(0.0F, 0.0F, hit->distance), hit->normal, 1.0F, hit->cell};
        const float distance =
            std::min(glm::length(query.eye - sample.position), glm::length(placeOf(point) - sample.position));
        const bool exact = isInSight(query, placeOf(point), sample);
        if (sight.cell(hit->cell).radius > distance / 16.0F) {
          EXPECT_EQ(of_point.sees(sample), exact);
          ++near;
        } else {
          EXPECT_EQ(of_point.sees(sample), cache.sees(*row, placeOf(point), hit->cell));
          differing += of_point.sees(sample) != exact ? 1 : 0;
          ++far;
        }
        sample.cell = SurfaceSample::kNoCell;
        EXPECT_EQ(of_point.sees(sample), exact);
      }
    }
  }
  EXPECT_GT(near, 500U);
  EXPECT_GT(far, 500U);
  EXPECT_LT(differing, far / 10) << "a cell is small, so that its place stands for all of it";
}

}  // namespace
}  // namespace plan
