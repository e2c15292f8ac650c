#include "base/number.h"

#include <gtest/gtest.h>

#include <string>

namespace base {
namespace {

TEST(Number, onlyWholeFiniteNumbersAreRead) {
  EXPECT_EQ(parseNumber("-1.25e2"), -125.0);
  EXPECT_EQ(parseNumber("+3"), 3.0);
  EXPECT_EQ(parseNumber(".5"), 0.5);
  EXPECT_EQ(parseNumber("4000016.2000000002"), 4000016.2000000002);
  for (const char* bad : {"",    "+",         "-",     ".",    "e5", "--1", "+-1", "-+1",   "+-1x", "nan",
                          "inf", "-infinity", "1e999", "0x10", "1 ", " 1",  "1,5", "1.2.3", "1e",   "1-2"})
    EXPECT_FALSE(parseNumber(bad)) << bad;
  EXPECT_FALSE(parseNumber(std::string(kMaxNumberLength + 1, '1')));
}

}  // namespace
}  // namespace base
