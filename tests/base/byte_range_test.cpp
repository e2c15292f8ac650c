#include "base/byte_range.h"

#include <gtest/gtest.h>

namespace base {
namespace {

using Kind = RangeRequest::Kind;

struct Row {
  const char* header;
  std::uint64_t size;
  Kind kind;
  std::uint64_t first, length;
};

TEST(ByteRange, parseRangeFollowsRfc9110) {
  const Row rows[] = {
      {"", 100, Kind::kWhole, 0, 100},
      {"bytes=0-0", 100, Kind::kPart, 0, 1},
      {"bytes=0-99", 100, Kind::kPart, 0, 100},
      {"bytes=10-19", 100, Kind::kPart, 10, 10},
      {"bytes=90-", 100, Kind::kPart, 90, 10},
      {"bytes=90-500", 100, Kind::kPart, 90, 10},
      {"bytes=-5", 100, Kind::kPart, 95, 5},
      {"bytes=-500", 100, Kind::kPart, 0, 100},
      {"bytes=99-99999999999999999999999999", 100, Kind::kPart, 99, 1},
      {"bytes=100-", 100, Kind::kUnsatisfiable, 0, 0},
      {"bytes=99999999999999999999999999-", 100, Kind::kUnsatisfiable, 0, 0},
      {"bytes=-0", 100, Kind::kUnsatisfiable, 0, 0},
      {"bytes=0-", 0, Kind::kUnsatisfiable, 0, 0},
      {"bytes=-1", 0, Kind::kUnsatisfiable, 0, 0},
      // A header that is not understood is ignored: the whole body is a right answer.
      {"bytes=5-4", 100, Kind::kWhole, 0, 100},
      {"bytes=", 100, Kind::kWhole, 0, 100},
      {"bytes=-", 100, Kind::kWhole, 0, 100},
      {"bytes=a-b", 100, Kind::kWhole, 0, 100},
      {"bytes=+1-2", 100, Kind::kWhole, 0, 100},
      {"bytes=0-1,5-6", 100, Kind::kWhole, 0, 100},
      {"items=0-1", 100, Kind::kWhole, 0, 100},
  };
  for (const Row& row : rows) {
    const RangeRequest range = parseRange(row.header, row.size);
    EXPECT_EQ(range.kind, row.kind) << row.header;
    if (row.kind == Kind::kUnsatisfiable) continue;
    EXPECT_EQ(range.first, row.first) << row.header;
    EXPECT_EQ(range.length, row.length) << row.header;
  }
}

TEST(ByteRange, formatContentRangeNamesTheLastByte) {
  EXPECT_EQ(formatContentRange(parseRange("bytes=10-19", 100), 100), "bytes 10-19/100");
  EXPECT_EQ(formatContentRange(parseRange("bytes=200-", 100), 100), "bytes */100");
}

TEST(ByteRange, parseContentRangeFollowsRfc9110) {
  const auto range = parseContentRange("bytes 2-5/26");
  ASSERT_TRUE(range && range->has_bytes);
  EXPECT_EQ(range->first, 2U);
  EXPECT_EQ(range->last, 5U);
  EXPECT_EQ(range->size, 26U);
  EXPECT_FALSE(parseContentRange("bytes 2-5/*")->size);
  EXPECT_FALSE(parseContentRange("bytes */26")->has_bytes);
  for (const char* wrong : {"", "bytes", "bytes /", "bytes 5-2/26", "bytes 2-26/26", "bytes 2-5", "bytes -5/26",
                            "items 2-5/26", "bytes 2-5/26 ", "bytes 2-5/99999999999999999999", "bytes +2-5/26"})
    EXPECT_FALSE(parseContentRange(wrong)) << wrong;
}

}  // namespace
}  // namespace base
