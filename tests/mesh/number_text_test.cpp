// leadingDecimal reads the same doubles as std::from_chars, to the last bit, and leaves all other numbers to it.
#include <gtest/gtest.h>

#include <bit>
#include <charconv>
#include <cstdio>
#include <limits>
#include <random>

#include "mesh/mesh_stream.h"

namespace {

using mesh::leadingDecimal;

double byLibrary(std::string_view text) {
  double value = std::numeric_limits<double>::quiet_NaN();
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

void expectTheSame(const std::string& text) {
  double value = 0.0;
  if (leadingDecimal(text, value) == 0) return;
  EXPECT_EQ(leadingDecimal(text, value), text.size()) << text;
  EXPECT_EQ(std::bit_cast<std::uint64_t>(value), std::bit_cast<std::uint64_t>(byLibrary(text))) << text;
}

TEST(NumberText, isReadToTheLastBit) {
  std::mt19937_64 random(5);
  int read = 0;
  for (int i = 0; i < 200000; ++i) {
    std::string text = random() % 2 == 0 ? "-" : "";
    for (std::uint64_t digits = random() % 10; digits > 0; --digits) text += static_cast<char>('0' + random() % 10);
    if (random() % 8 != 0) text += '.';
    for (std::uint64_t digits = random() % 10; digits > 0; --digits) text += static_cast<char>('0' + random() % 10);
    expectTheSame(text);
    double value = 0.0;
    read += leadingDecimal(text, value) > 0 ? 1 : 0;
  }
  EXPECT_GT(read, 150000) << "most are short enough";
  for (const char* text : {"0", "-0", "-0.0", "000.1", "9007199254740992", "0.1", "5.", ".5", "123456789.012345678",
                           "0.000000000000000001", "90071992547.40991"})
    expectTheSame(text);
}

TEST(NumberText, leavesAllButPlainDecimalsToFromChars) {
  double value = 0.0;
  for (const char* text : {"", "-", ".", "-.", "+1", "1e5", "1.5x", "1.2.3", "nan", "inf", "0x10", "--1",
                           "9007199254740993", "1234567890123456789", " 1", "1#"})
    EXPECT_EQ(leadingDecimal(text, value), 0U) << text;
}

TEST(NumberText, endsAtASpace) {
  double value = 0.0;
  EXPECT_EQ(leadingDecimal("-1.25 2.5", value), 5U);
  EXPECT_EQ(value, -1.25);
  EXPECT_EQ(leadingDecimal("3\t4", value), 1U);
  EXPECT_EQ(value, 3.0);
}

}  // namespace
