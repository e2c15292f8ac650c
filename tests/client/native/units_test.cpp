#include "client/native/units.h"

#include <gtest/gtest.h>

namespace client {
namespace {

TEST(Units, bytesAreDecimal) {
  EXPECT_EQ(*parseByteCount("50M"), 50'000'000U);
  EXPECT_EQ(*parseByteCount("1.5G"), 1'500'000'000U);
  EXPECT_EQ(*parseByteCount("512k"), 512'000U);
  EXPECT_EQ(*parseByteCount("1000"), 1000U);
}

TEST(Units, ratesAreBitsAndComeBackAsBytes) {
  EXPECT_DOUBLE_EQ(*parseBitRate("20Mbit"), 2.5e6);
  EXPECT_DOUBLE_EQ(*parseBitRate("384kbit"), 48e3);
  EXPECT_DOUBLE_EQ(*parseBitRate("1Gbit"), 125e6);
  EXPECT_DOUBLE_EQ(*parseBitRate("8"), 1.0);
}

TEST(Units, durationsAreSeconds) {
  EXPECT_DOUBLE_EQ(*parseDuration("30ms"), 0.03);
  EXPECT_DOUBLE_EQ(*parseDuration("0.5s"), 0.5);
  EXPECT_DOUBLE_EQ(*parseDuration("2"), 2.0);
}

TEST(Units, sizesAreTwoSides) {
  EXPECT_EQ(*parseViewSize("1280x720"), std::pair(1280, 720));
  for (const char* bad : {"", "x", "1280", "1280x", "x720", "0x5", "-1x5", "5x16385", "1280x720p", "1280 x 720"})
    EXPECT_FALSE(bool(parseViewSize(bad))) << bad;
}

TEST(Units, coloursAreHexadecimal) {
  EXPECT_EQ(*parseColor("#ff0000"), (std::array<float, 4>{1.0F, 0.0F, 0.0F, 1.0F}));
  EXPECT_EQ(*parseColor("#0000ff00"), (std::array<float, 4>{0.0F, 0.0F, 1.0F, 0.0F}));
  EXPECT_EQ(*parseColor("transparent"), (std::array<float, 4>{0.0F, 0.0F, 0.0F, 0.0F}));
  for (const char* bad : {"", "red", "#fff", "#gg0000", "#-10000", "ff0000", "#ff00000"})
    EXPECT_FALSE(bool(parseColor(bad))) << bad;
}

TEST(Units, wrongValuesNameThemselves) {
  for (const char* bad : {"", "M", "-5M", "5T", "5 M", "nan", "inf", "1e30", "50Mb"}) {
    auto value = parseByteCount(bad);
    ASSERT_FALSE(bool(value)) << bad;
    EXPECT_EQ(value.error().message.find(std::string("'").append(bad).append("'")), 0U) << value.error().message;
  }
  EXPECT_FALSE(bool(parseBitRate("20MB")));
  EXPECT_FALSE(bool(parseDuration("5min")));
}

}  // namespace
}  // namespace client
