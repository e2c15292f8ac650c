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

TEST(Text, coloursAreSixDigitsBehindASharp) {
  EXPECT_EQ(base::formatRgb({0, 255, 16}), "#00ff10");
  EXPECT_EQ(base::parseRgb("#00Ff10"), (base::Rgb{0, 255, 16}));
  for (const char* bad : {"", "#", "00ff10", "#00ff1", "#00ff100", "#00ff1g", "#-1ff10", "#+1ff10", "# 1ff10"})
    EXPECT_FALSE(base::parseRgb(bad)) << bad;
}

TEST(Text, plainTextIsUtf8WithoutControlCharacters) {
  for (const char* good : {"", "a b", "S\u00F6hne \u00A9 \u65E5\u672C \U0001F30B"})
    EXPECT_TRUE(base::isPlainText(good)) << good;
  for (const char* bad : {"a\nb", "\x1B[31m", "\x7F", "\xFF", "\xC3", "\xC0\x80", "\xED\xA0\x80", "\xF5\x80\x80\x80"})
    EXPECT_FALSE(base::isPlainText(bad)) << bad;
  EXPECT_TRUE(base::isPlainText("a\nb", "\n\t"));
}

TEST(Text, utf8SequencesAreMeasuredAndRead) {
  const auto read = [](std::string_view text) { return base::utf8Character(text, base::utf8Length(text)); };
  EXPECT_EQ(read("ab"), 0x61U);
  EXPECT_EQ(read("\xC2\x9B"), 0x9BU);
  EXPECT_EQ(read("\xE2\x82\xAC."), 0x20ACU);
  EXPECT_EQ(read("\xF0\x9F\x98\x80"), 0x1F600U);
  for (const char* invalid :
       {"\x80", "\xC0\x80", "\xE2\x82", "\xE0\x80\x80", "\xED\xA0\x80", "\xF4\x90\x80\x80", "\xFF"})
    EXPECT_EQ(base::utf8Length(invalid), 0U);
}

}  // namespace
