#pragma once
// Checks for a caller's mistakes: they print the place and both values, and stop the program. Bytes from disk or wire
// are never checked so; they give a base::Error.
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>
#include <type_traits>

namespace base {

[[noreturn]] inline void failCheck(const char* file, int line, const char* condition, const std::string& values) {
  std::fprintf(stderr, "%s:%d: check failed: %s%s\n", file, line, condition, values.c_str());
  std::abort();
}

// Streams are avoided, since they would bring the locales of the standard library into the browser.
inline std::string describe(std::string_view text) {
  return std::string(text);
}
template <class Number>
requires std::is_arithmetic_v<Number> std::string describe(Number number) {
  return std::to_string(number);
}

template <class A, class B>
std::string describePair(const A& a, const B& b) {
  return " (" + describe(a) + " against " + describe(b) + ")";
}

}  // namespace base

#define LUMIGRID_CHECK(condition)                                            \
  do {                                                                       \
    if (!(condition)) ::base::failCheck(__FILE__, __LINE__, #condition, ""); \
  } while (false)

#define LUMIGRID_CHECK_OP(a, op, b)                                                                            \
  do {                                                                                                         \
    if (!((a)op(b))) ::base::failCheck(__FILE__, __LINE__, #a " " #op " " #b, ::base::describePair((a), (b))); \
  } while (false)
#define LUMIGRID_CHECK_EQ(a, b) LUMIGRID_CHECK_OP(a, ==, b)
#define LUMIGRID_CHECK_LE(a, b) LUMIGRID_CHECK_OP(a, <=, b)
#define LUMIGRID_CHECK_LT(a, b) LUMIGRID_CHECK_OP(a, <, b)
