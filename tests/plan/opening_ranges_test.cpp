// Tests which bytes of a published hierarchy are named as those of its first picture.
#include "plan/opening_ranges.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/file.h"
#include "plan/view_plan.h"
#include "tests/server/session/memory_store.h"

namespace plan {
namespace {

using base::FileRange;

base::Result<std::vector<FileRange>> rangesOf(const base::Bytes& file) {
  return openingRanges([&](const FileRange& range) -> base::Result<base::Bytes> {
    if (range.offset + range.length > file.size()) return base::Error{base::ErrorCode::kIo, "is cut short"};
    const auto first = file.begin() + static_cast<std::ptrdiff_t>(range.offset);
    return base::Bytes(first, first + static_cast<std::ptrdiff_t>(range.length));
  });
}

TEST(OpeningRanges, holdRecordsAndBlocksOfTheCoarsestGroups) {
  const server::TestScene scene(16);
  const auto file = base::readFile(scene.path);
  ASSERT_TRUE(file);
  const auto ranges = rangesOf(*file);
  ASSERT_TRUE(ranges) << ranges.error().message;
  ASSERT_FALSE(ranges->empty());
  EXPECT_LE(ranges->size(), kMaxOpeningRanges);
  EXPECT_EQ(ranges->front().offset, 0U);

  const auto counts = lod::patch::readTableCounts(*file);
  ASSERT_TRUE(counts);
  lod::patch::TablePages pages(*counts);
  std::uint64_t bytes = 0;
  for (const FileRange& range : *ranges) {
    pages.add(range.offset, base::ByteView(*file).subspan(range.offset, range.length));
    bytes += range.length;
  }
  const lod::patch::Hierarchy& hierarchy = scene.data.patches->hierarchy();
  const auto coarse = coarseGroups(hierarchy, 20'000);
  ASSERT_GT(coarse.size(), 1U) << "more than one group is asked for";
  std::uint64_t of_blocks = 0;
  for (const std::uint32_t group : coarse) {
    const auto record = pages.record(group);
    ASSERT_TRUE(record);
    EXPECT_TRUE(record->missing.empty()) << "group " << group;
    const lod::patch::Group& row = hierarchy.groups[group];
    EXPECT_TRUE(std::any_of(ranges->begin(), ranges->end(),
                            [&](const FileRange& range) {
                              return range.offset <= row.block_offset &&
                                     row.block_offset + row.block_bytes <= range.offset + range.length;
                            }))
        << "group " << group;
    of_blocks += row.block_bytes;
  }
  EXPECT_LT(bytes - of_blocks, counts->blocks_offset * 3 / 4) << "not all of the tables is read, and no other block";
}

TEST(OpeningRanges, ofADamagedFileAreAnError) {
  const server::TestScene scene(16);
  auto file = base::readFile(scene.path);
  ASSERT_TRUE(file);
  ASSERT_TRUE(rangesOf(*file));
  (*file)[200] ^= 1;  // a row
  const auto damaged = rangesOf(*file);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().code, base::ErrorCode::kInvalidInput);
  file->resize(90);
  EXPECT_FALSE(rangesOf(*file));
}

}  // namespace
}  // namespace plan
