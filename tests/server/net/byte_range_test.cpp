#include "server/net/byte_range.h"

#include <gtest/gtest.h>

namespace server {
namespace {

using Kind = ByteRange::Kind;

struct Row {
  const char* header;
  std::uint64_t size;
  Kind kind;
  std::uint64_t first, length;
};

TEST(ByteRange, headersAreReadAsRfc9110Says) {
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
      // Not understood: the whole is a right answer.
      {"bytes=5-4", 100, Kind::kWhole, 0, 100},
      {"bytes=", 100, Kind::kWhole, 0, 100},
      {"bytes=-", 100, Kind::kWhole, 0, 100},
      {"bytes=a-b", 100, Kind::kWhole, 0, 100},
      {"bytes=+1-2", 100, Kind::kWhole, 0, 100},
      {"bytes=0-1,5-6", 100, Kind::kWhole, 0, 100},
      {"items=0-1", 100, Kind::kWhole, 0, 100},
  };
  for (const Row& row : rows) {
    const ByteRange range = parseByteRange(row.header, row.size);
    EXPECT_EQ(range.kind, row.kind) << row.header;
    if (row.kind == Kind::kUnsatisfiable) continue;
    EXPECT_EQ(range.first, row.first) << row.header;
    EXPECT_EQ(range.length, row.length) << row.header;
  }
}

TEST(ByteRange, contentRangeNamesTheLastByte) {
  EXPECT_EQ(contentRange(parseByteRange("bytes=10-19", 100), 100), "bytes 10-19/100");
  EXPECT_EQ(contentRange(parseByteRange("bytes=200-", 100), 100), "bytes */100");
}

}  // namespace
}  // namespace server
