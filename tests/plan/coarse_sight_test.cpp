#include "plan/coarse_sight.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "plan/view_plan.h"
#include "tests/server/session/memory_store.h"

namespace plan {
namespace {

class CoarseSight : public testing::Test {
 protected:
  base::ByteView blockOf(std::uint32_t group) const {
    return blocks_.insert_or_assign(group, *scene_.patches->block(group)).first->second;
  }
  base::Result<lod::patch::ProxySight> sightOf(const std::vector<std::uint32_t>& groups) const {
    return makeCoarseSight(scene_.patches->hierarchy(), groups, [this](std::uint32_t group) { return blockOf(group); });
  }
  const server::TestScene scene_{16};
  mutable std::map<std::uint32_t, base::Bytes> blocks_;
};

// The groups whose error is above a limit are those that the cut of that error expands.
TEST_F(CoarseSight, isTheCutOfTheExpandedGroups) {
  const lod::patch::Hierarchy& hierarchy = scene_.patches->hierarchy();
  for (const std::uint64_t bytes : {1'000U, 10'000U, 1'000'000'000U}) {
    const auto groups = coarseGroups(hierarchy, bytes);
    const auto sight = sightOf(groups);
    ASSERT_TRUE(sight) << sight.error().message;
    std::uint64_t triangles = 0;
    float error = 0.0F;
    for (const std::uint32_t group : groups)
      for (std::uint32_t i = 0; i < hierarchy.groups[group].patch_count; ++i) {
        const lod::patch::Patch& patch = hierarchy.patches[hierarchy.groups[group].first_patch + i];
        if (std::count(groups.begin(), groups.end(), patch.producer) != 0) continue;
        triangles += patch.triangles;
        if (patch.producer != lod::patch::kNoGroup) error = std::max(error, hierarchy.groups[patch.producer].error);
      }
    EXPECT_EQ(sight->triangleCount(), triangles);
    EXPECT_EQ(sight->error(), error);
  }
  // With all groups the cut is the leaves, so the source itself occludes.
  EXPECT_EQ(sightOf(coarseGroups(hierarchy, 1'000'000'000))->error(), 0.0F);
}

TEST_F(CoarseSight, seesTheSurfaceBetweenAboveAndBelow) {
  const auto sight = sightOf(coarseGroups(scene_.patches->hierarchy(), kCoarseBytes));
  ASSERT_TRUE(sight);
  const glm::vec3 center(scene_.center());
  const float side = scene_.data.welcome.box_max.x - scene_.data.welcome.box_min.x;
  const glm::vec3 up(0.0F, 0.0F, side);
  EXPECT_TRUE(sight->isBlocked(center + up, center - up, 0.0F));
  EXPECT_FALSE(sight->isBlocked(center + up, center + 2.0F * up, 0.0F));
}

TEST_F(CoarseSight, blocksCutShortAreAnError) {
  const std::vector<std::uint32_t> groups = coarseGroups(scene_.patches->hierarchy(), 10'000);
  for (std::size_t cut = 1; cut <= 8; ++cut)
    EXPECT_FALSE(makeCoarseSight(scene_.patches->hierarchy(), groups, [&](std::uint32_t group) {
      const base::ByteView block = blockOf(group);
      return block.first(block.size() - std::min(block.size(), cut * block.size() / 8));
    }));
}

}  // namespace
}  // namespace plan
