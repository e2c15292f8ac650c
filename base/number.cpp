#include "base/number.h"

#include <charconv>
#include <cmath>
#include <string>

#ifdef __EMSCRIPTEN__
#include <emscripten/emscripten.h>

// The page reads numbers by JavaScript, since strtod brings 128-bit arithmetic along, a thirtieth of the whole program.
EM_JS(double, lumigridNumber, (const char* text), { return Number(UTF8ToString(text)); });
#endif

namespace base {
namespace {

#ifdef __EMSCRIPTEN__
/// NaN for a text that is no number.
double plainNumber(std::string_view text) {
  return lumigridNumber(std::string(text).c_str());
}
#else
double plainNumber(std::string_view text) {
  double value = 0.0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  return result.ec == std::errc() && result.ptr == text.data() + text.size() ? value : std::nan("");
}
#endif

}  // namespace

std::optional<double> parseNumber(std::string_view text) {
  if (text.size() > kMaxNumberLength || text.find_first_not_of("0123456789+-.eE") != text.npos) return std::nullopt;
  const std::size_t sign = !text.empty() && (text.front() == '+' || text.front() == '-') ? 1 : 0;
  const std::string_view magnitude = text.substr(sign);
  if (magnitude.find_first_of("0123456789.") != 0) return std::nullopt;
  const double value = plainNumber(magnitude);
  if (!std::isfinite(value)) return std::nullopt;
  return text.front() == '-' ? -value : value;
}

std::optional<std::uint64_t> parseDecimal(std::string_view text) {
  constexpr std::size_t kMaxDigits = 18;  // 10^18 < 2^63
  if (text.size() > kMaxDigits) return std::nullopt;
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? std::optional(value) : std::nullopt;
}

}  // namespace base
