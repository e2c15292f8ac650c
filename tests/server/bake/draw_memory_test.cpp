#include "server/bake/draw_memory.h"

#include <gtest/gtest.h>

namespace server {
namespace {

constexpr std::uint64_t kMebi = std::uint64_t{1} << 20;
constexpr std::uint64_t kGibi = std::uint64_t{1} << 30;

// Makes the tables of a scan of so many triangles in leaves of 3,000, and half as much again above them.
lod::patch::Hierarchy scanOf(std::uint64_t triangles) {
  lod::patch::Hierarchy hierarchy;
  hierarchy.source_triangles = triangles;
  hierarchy.patches.resize(triangles / 2000);
  for (lod::patch::Patch& patch : hierarchy.patches) patch.triangles = 3000, patch.vertices = 1600;
  hierarchy.groups.resize(hierarchy.patches.size() / 6);
  return hierarchy;
}

class DrawMemoryTest : public testing::Test {
 protected:
  DrawDemand demandOf(const lod::patch::Hierarchy& hierarchy, std::uint32_t face_size = 512) const {
    RenderOptions render;
    render.supersampling = 2;
    return {hierarchy, face_size, render, 300, 856, 0, 16, true};
  }
  // The memory that is needed at least, from the error's "--memory 123M".
  static std::uint64_t asked(const base::Error& error) {
    const std::size_t at = error.message.find("--memory ");
    return at == std::string::npos ? 0 : std::stoull(error.message.substr(at + 9)) * kMebi;
  }
  const lod::patch::Hierarchy small_ = scanOf(20'000);
  const lod::patch::Hierarchy large_ = scanOf(100'000'000);
};

TEST_F(DrawMemoryTest, withoutALimitAllCoresDraw) {
  const auto limits = limitDrawing(demandOf(large_), 0);
  ASSERT_TRUE(limits);
  EXPECT_EQ(limits->processes, 16U);
  EXPECT_EQ(limits->gpu_budget_bytes, 256 * kMebi);
}

TEST_F(DrawMemoryTest, moreMemoryNeverMeansFewerProcesses) {
  for (const lod::patch::Hierarchy* hierarchy : {&small_, &large_}) {
    unsigned before = 0;
    for (std::uint64_t memory = kGibi; memory <= 32 * kGibi; memory += 256 * kMebi) {
      const auto limits = limitDrawing(demandOf(*hierarchy), memory);
      ASSERT_TRUE(limits) << limits.error().message;
      EXPECT_GE(limits->processes, before) << memory;
      before = limits->processes;
    }
    EXPECT_EQ(before, 16U);
  }
}

// With patches alone 10 GiB hold less than sixteen times the 2 GiB that one process would take.
TEST_F(DrawMemoryTest, budgetsOfAllProcessesStayBelowTheMemory) {
  for (std::uint64_t memory = kGibi; memory <= 32 * kGibi; memory += 256 * kMebi) {
    const auto limits = limitDrawing(demandOf(large_), memory);
    ASSERT_TRUE(limits) << limits.error().message;
    EXPECT_LT(limits->processes * limits->gpu_budget_bytes, memory);
    EXPECT_GE(limits->gpu_budget_bytes, 32 * kMebi);
  }
}

// A process of llvmpipe that draws three million triangles at 1024 pixels with a budget of 32 MiB took 394 MB.
TEST_F(DrawMemoryTest, aProcessCountsWithMoreThanItsPatches) {
  const lod::patch::Hierarchy scan = scanOf(3'000'000);
  const auto limits = limitDrawing(demandOf(scan, 1024), 4 * kGibi);
  ASSERT_TRUE(limits);
  EXPECT_GT(limits->processes, 1U);
  EXPECT_LE(limits->processes * std::uint64_t{394} * kMebi, 4 * kGibi);
}

TEST_F(DrawMemoryTest, whereNotOneFitsTheErrorSaysHowMuchDoes) {
  for (const bool in_processes : {true, false}) {
    DrawDemand demand = demandOf(large_, 2048);
    demand.in_processes = in_processes;
    const auto refused = limitDrawing(demand, 256 * kMebi);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kNoSpace);
    const std::uint64_t enough = asked(refused.error());
    ASSERT_GT(enough, 256 * kMebi) << refused.error().message;
    EXPECT_FALSE(limitDrawing(demand, enough - kMebi));
    const auto limits = limitDrawing(demand, enough);
    ASSERT_TRUE(limits) << limits.error().message;
    EXPECT_EQ(limits->processes, in_processes ? 1U : 0U);
    EXPECT_EQ(limits->encoders, 1U);
  }
}

// With shadows pictures are drawn whole.
TEST_F(DrawMemoryTest, smallTilesLeaveRoomForMoreProcesses) {
  for (const bool has_shadows : {false, true}) {
    DrawDemand demand = demandOf(small_, 2048);
    if (has_shadows) demand.shadow_bytes = 1;
    const auto whole = limitDrawing(demand, 4 * kGibi);
    demand.render.tile_samples = std::uint64_t{1} << 20;
    const auto in_tiles = limitDrawing(demand, 4 * kGibi);
    ASSERT_TRUE(whole && in_tiles);
    EXPECT_EQ(in_tiles->processes > whole->processes, !has_shadows);
  }
}

TEST_F(DrawMemoryTest, aSampleLeavesTheRestToPatches) {
  const DrawDemand demand = demandOf(large_);
  const auto all = limitSampling(demand, 0, 0);
  const auto some = limitSampling(demand, 400 * kMebi, kGibi);
  ASSERT_TRUE(all && some);
  EXPECT_EQ(*all, 2 * kGibi);
  EXPECT_LT(*some, 624 * kMebi);
  const auto refused = limitSampling(demand, kGibi, kGibi);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, base::ErrorCode::kNoSpace);
}

}  // namespace
}  // namespace server
