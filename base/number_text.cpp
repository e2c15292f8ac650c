#include "base/number_text.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace base {
namespace {

constexpr std::uint64_t kMostDigits = 1'000'000'000'000'000'000;  // a digit more fits below it
constexpr int kExactPower = 22;                                   // 10^22 is the largest power of ten that a double is
constexpr int kMostExponent = 10'000;

bool isDigit(char c) {
  return c >= '0' && c <= '9';
}

/// Takes '+' or '-' off the front; whether it was '-'.
bool takeSign(std::string_view& text) {
  const bool negative = !text.empty() && text.front() == '-';
  if (negative || (!text.empty() && text.front() == '+')) text.remove_prefix(1);
  return negative;
}

double powerOfTen(int exponent) {
  if (exponent > kExactPower) return std::pow(10.0, exponent);
  double power = 1.0;
  for (int i = 0; i < exponent; ++i) power *= 10.0;
  return power;
}

}  // namespace

std::optional<double> readNumber(std::string_view text) {
  const bool negative = takeSign(text);

  // The digits as one whole number; those that do not fit only move the exponent.
  std::uint64_t digits = 0;
  int exponent = 0;
  bool any = false;
  bool behind_point = false;
  for (; !text.empty() && (isDigit(text.front()) || (text.front() == '.' && !behind_point)); text.remove_prefix(1)) {
    if (text.front() == '.') {
      behind_point = true;
      continue;
    }
    any = true;
    const bool fits = digits < kMostDigits;
    if (fits) digits = 10 * digits + static_cast<std::uint64_t>(text.front() - '0');
    exponent += (fits ? 0 : 1) - (behind_point ? 1 : 0);
  }
  if (!any) return std::nullopt;

  if (!text.empty() && (text.front() == 'e' || text.front() == 'E')) {
    text.remove_prefix(1);
    const bool down = takeSign(text);
    if (text.empty()) return std::nullopt;
    int given = 0;
    for (; !text.empty() && isDigit(text.front()); text.remove_prefix(1))
      given = std::min(kMostExponent, 10 * given + (text.front() - '0'));
    exponent += down ? -given : given;
  }
  if (!text.empty()) return std::nullopt;

  const auto whole = static_cast<double>(digits);
  const double value = exponent < 0 ? whole / powerOfTen(-exponent) : digits == 0 ? 0.0 : whole * powerOfTen(exponent);
  return negative ? -value : value;
}

}  // namespace base
