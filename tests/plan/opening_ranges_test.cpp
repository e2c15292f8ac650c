// Tests which bytes of a published hierarchy are named as those of its first picture.
#include "plan/opening_ranges.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "lod/patch/group_records.h"
#include "plan/view_plan.h"
#include "tests/server/session/memory_store.h"

namespace plan {
namespace {

using base::FileRange;
using lod::patch::GroupRecords;

TEST(OpeningRanges, holdRecordsAndBlocksOfTheCoarsestGroups) {
  const server::TestScene scene(16);
  const lod::patch::Hierarchy& hierarchy = scene.data.patches->hierarchy();
  const base::Bytes records = lod::patch::encodeRecords(hierarchy, scene.patches->fileBytes());
  const auto ranges = openingRanges(hierarchy, records);
  ASSERT_TRUE(ranges) << ranges.error().message;
  ASSERT_FALSE(ranges->blocks.empty());
  EXPECT_LE(ranges->blocks.size(), kMaxOpeningRanges);
  EXPECT_EQ(ranges->records.offset, 0U);

  const auto read = GroupRecords::open(base::ByteView(records).first(ranges->records.length));
  ASSERT_TRUE(read) << read.error().message;
  const auto coarse = coarseGroups(hierarchy, 20'000);
  ASSERT_GT(coarse.size(), 1U) << "more than one group is asked for";
  std::uint64_t of_blocks = 0, bytes = 0;
  for (const std::uint32_t group : coarse) {
    EXPECT_FALSE(read->record(group).empty()) << "group " << group;
    const lod::patch::Group& row = hierarchy.groups[group];
    EXPECT_TRUE(std::any_of(ranges->blocks.begin(), ranges->blocks.end(),
                            [&](const FileRange& range) {
                              return range.offset <= row.block_offset &&
                                     row.block_offset + row.block_bytes <= range.offset + range.length;
                            }))
        << "group " << group;
    of_blocks += row.block_bytes;
  }
  for (const FileRange& range : ranges->blocks) bytes += range.length;
  EXPECT_LE(bytes, of_blocks + 1024 * ranges->blocks.size()) << "no other blocks";
}

TEST(OpeningRanges, haveAllRecordsOfASmallSceneAlone) {
  const auto shareOfRecords = [](int n) {
    const server::TestScene scene(n);
    const lod::patch::Hierarchy& hierarchy = scene.data.patches->hierarchy();
    const base::Bytes records = lod::patch::encodeRecords(hierarchy, scene.patches->fileBytes());
    const auto ranges = openingRanges(hierarchy, records);
    EXPECT_TRUE(ranges) << ranges.error().message;
    return static_cast<double>(ranges->records.length) / static_cast<double>(records.size());
  };
  EXPECT_EQ(shareOfRecords(8), 1.0);
  EXPECT_LT(shareOfRecords(64), 0.5);
}

TEST(OpeningRanges, ofDamagedRecordsAreAnError) {
  const server::TestScene scene(16);
  const lod::patch::Hierarchy& hierarchy = scene.data.patches->hierarchy();
  base::Bytes records = lod::patch::encodeRecords(hierarchy, scene.patches->fileBytes());
  records[200] ^= 1;
  const auto damaged = openingRanges(hierarchy, records);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_FALSE(openingRanges(hierarchy, base::ByteView(records).first(90)));
}

}  // namespace
}  // namespace plan
