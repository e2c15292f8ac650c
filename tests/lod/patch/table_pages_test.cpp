#include "lod/patch/table_pages.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <random>

#include "lod/patch/format.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

/// Holds a patch.lgp whose tables fill some 20 pages.
struct File {
  File() {
    const std::string path =
        (std::filesystem::temp_directory_path() / ("table_pages_test_" + std::to_string(::getpid()) + ".lgp")).string();
    EXPECT_TRUE(support::writeSynthetic(support::syntheticHierarchy(24), path));
    bytes = *base::readFile(path);
    hierarchy = *readTables(bytes);
    std::filesystem::remove(path);
    counts = *readTableCounts(bytes);
  }
  base::Bytes bytes;
  Hierarchy hierarchy;
  TableCounts counts;
};

const File& file() {
  static const File made;
  return made;
}

base::ByteView page(const TablePages& tables, std::uint32_t number) {
  return base::ByteView(file().bytes).subspan(tables.pageOffset(number), tables.pageLength(number));
}

base::Bytes expectedRecord(std::uint32_t group) {
  base::ByteWriter out;
  encodeGroup(file().hierarchy, group, out);
  return out.takeBytes();
}

TEST(TablePages, countsAreTheHeaders) {
  const TableCounts& counts = file().counts;
  EXPECT_EQ(counts.groups, file().hierarchy.groups.size());
  EXPECT_EQ(counts.patches, file().hierarchy.patches.size());
  EXPECT_EQ(counts.parents, file().hierarchy.parents.size());
  EXPECT_EQ(counts.file_bytes, file().bytes.size());
  EXPECT_EQ(counts.blocks_offset, file().hierarchy.groups[0].block_offset);
  for (std::size_t length = 0; length < 96; ++length)
    EXPECT_FALSE(readTableCounts(base::ByteView(file().bytes).first(length)));
}

TEST(TablePages, recordsAreWhatAServerSends) {
  TablePages tables(file().counts);
  ASSERT_GT(tables.pageCount(), 10U);
  tables.add(0, base::ByteView(file().bytes));
  EXPECT_EQ(tables.pagesHere(), tables.pageCount());
  EXPECT_TRUE(tables.checkWhole());
  EXPECT_EQ(tables.leadingRows(), file().counts.groups);
  for (std::uint32_t group = 0; group < file().counts.groups; ++group) {
    const auto record = tables.record(group);
    ASSERT_TRUE(record) << record.error().message;
    EXPECT_TRUE(record->missing.empty());
    EXPECT_EQ(record->bytes, expectedRecord(group));
  }
}

// Whichever page comes first, fetching the pages named as missing leads to the record.
TEST(TablePages, missingPagesLeadToTheRecord) {
  std::mt19937 random(3);
  for (std::uint32_t group = 0; group < file().counts.groups; group += 7) {
    TablePages tables(file().counts);
    tables.add(0, page(tables, 0));
    for (int i = 0; i < 3; ++i) {
      const auto some = static_cast<std::uint32_t>(random() % tables.pageCount());
      tables.add(tables.pageOffset(some), page(tables, some));
    }
    int rounds = 0;
    for (; rounds < 4; ++rounds) {
      const auto record = tables.record(group);
      ASSERT_TRUE(record);
      if (record->missing.empty()) {
        EXPECT_EQ(record->bytes, expectedRecord(group));
        break;
      }
      EXPECT_TRUE(record->bytes.empty());
      for (const std::uint32_t number : record->missing) {
        EXPECT_FALSE(tables.has(number));
        tables.add(tables.pageOffset(number), page(tables, number));
      }
    }
    EXPECT_LT(rounds, 4);
  }
}

TEST(TablePages, onlyWholePagesAreKept) {
  TablePages tables(file().counts);
  tables.add(1, base::ByteView(file().bytes).subspan(1, 2 * TablePages::kPageBytes));
  EXPECT_FALSE(tables.has(0));
  EXPECT_TRUE(tables.has(1));
  EXPECT_FALSE(tables.has(2));
  const std::uint32_t last = tables.pageCount() - 1;
  tables.add(tables.pageOffset(last), page(tables, last).first(tables.pageLength(last) - 1));
  EXPECT_FALSE(tables.has(last));
  tables.add(tables.pageOffset(last), page(tables, last));
  EXPECT_TRUE(tables.has(last));
  EXPECT_FALSE(tables.checkWhole());
  EXPECT_FALSE(tables.row(file().counts.groups - 1)->has_value() && !tables.has(1));
}

TEST(TablePages, damageIsNoticed) {
  base::Bytes changed = file().bytes;
  changed[96 + 68 * 3 + 20] ^= 1;
  TablePages tables(file().counts);
  tables.add(0, changed);
  EXPECT_FALSE(tables.checkWhole());

  // One row names patches that are not there, the other a block outside the file.
  const auto rowFails = [](std::size_t at, std::uint32_t value) {
    base::Bytes bytes = file().bytes;
    std::memcpy(bytes.data() + 96 + 68 * 3 + at, &value, sizeof(value));
    TablePages damaged(file().counts);
    damaged.add(0, bytes);
    return !damaged.row(3) && !damaged.record(3);
  };
  EXPECT_TRUE(rowFails(40, file().counts.patches));
  EXPECT_TRUE(rowFails(44, 0xFFFFFFFFU));
  EXPECT_TRUE(rowFails(48, 0xFFFFFFF0U));
  EXPECT_TRUE(rowFails(56, 0xFFFFFFFFU));
  EXPECT_TRUE(rowFails(64, 1));
}

}  // namespace
}  // namespace lod::patch
