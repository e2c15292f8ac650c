#include "base/number_text.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>

namespace base {
namespace {

TEST(NumberText, whatIsPrintedIsReadAsStrtodReadsIt) {
  std::mt19937_64 random(7);
  std::array<char, 400> text{};
  for (int i = 0; i < 20'000; ++i) {
    const double unit = static_cast<double>(random() >> 11U) / 9007199254740992.0 - 0.5;
    const double value = unit * std::pow(10.0, static_cast<double>(random() % 13) - 3.0);
    for (const int decimals : {0, 1, 4, 5}) {
      std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
      ASSERT_EQ(readNumber(text.data()), std::strtod(text.data(), nullptr)) << text.data();
    }
    std::snprintf(text.data(), text.size(), "%.9g", value * std::pow(10.0, static_cast<double>(random() % 10)));
    ASSERT_EQ(readNumber(text.data()), std::strtod(text.data(), nullptr)) << text.data();
    std::snprintf(text.data(), text.size(), "%.17g", value);
    ASSERT_NEAR(*readNumber(text.data()), value, 4.0 * std::numeric_limits<double>::epsilon() * std::abs(value));
  }
}

TEST(NumberText, everyWayToWriteANumberIsRead) {
  for (const char* text : {"0", "-0", "5", "+5", "5.", ".5", "-.5", "007", "1e3", "1E+3", "2.5e-3", "1e22",
                           "123456789012345678901234567890", "0.000000000000000000000000001", "1e400", "-1e400",
                           "1e-400", "0e999999999999"})
    EXPECT_EQ(readNumber(text), std::strtod(text, nullptr)) << text;
}

TEST(NumberText, whatIsNoNumberIsRefused) {
  for (const char* text :
       {"", "+", "-", ".", "e5", "1e", "1e+", "1.2.3", "--1", "1 ", " 1", "1x", "0x10", "nan", "inf", "1e5.5", "1e5e5"})
    EXPECT_FALSE(readNumber(text)) << text;
}

}  // namespace
}  // namespace base
