// Numbers are written as people read them.
#include "base/text.h"

#include <gtest/gtest.h>

#include "base/format_text.h"

namespace {

TEST(Text, formatTextWritesTextsOfAnyLength) {
  const std::string longer(5000, 'x');
  EXPECT_EQ(base::formatText("%s|%d", longer.c_str(), 7), longer + "|7");
  EXPECT_EQ(base::formatText("%.9g, %04u", 0.1, 12U), "0.1, 0012");
  EXPECT_EQ(base::formatText("%s", ""), "");
}

TEST(Text, formatBytesUsesUnitsOfAThousand) {
  EXPECT_EQ(base::formatBytes(0), "0 B");
  EXPECT_EQ(base::formatBytes(999), "999 B");
  EXPECT_EQ(base::formatBytes(350'000), "350.0 kB");
  EXPECT_EQ(base::formatBytes(1'500'000), "1.5 MB");
  EXPECT_EQ(base::formatBytes(12'000'000'000), "12.0 GB");
}

TEST(Text, formatCountGroupsThreeDigitsAtATime) {
  EXPECT_EQ(base::formatCount(7), "7");
  EXPECT_EQ(base::formatCount(123), "123");
  EXPECT_EQ(base::formatCount(3'024'763), "3,024,763");
  EXPECT_EQ(base::formatCount(1'234'567, ' '), "1 234 567");
}

TEST(Text, trimmedTextHasNoBlanksAtItsEnds) {
  EXPECT_EQ(base::trimmed(" \ta b\r\n"), "a b");
  EXPECT_EQ(base::trimmed(" \r\n"), "");
}

}  // namespace
