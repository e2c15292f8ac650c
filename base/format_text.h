#pragma once
// Numbers and texts put together by the patterns of printf.
#include <cstdarg>
#include <cstdio>
#include <string>

namespace base {

/// The text that printf would write, of any length.
[[gnu::format(printf, 1, 2)]] inline std::string formatText(const char* pattern, ...) {
  std::va_list values;
  va_start(values, pattern);
  std::va_list measured;
  va_copy(measured, values);
  std::string text(static_cast<std::size_t>(std::vsnprintf(nullptr, 0, pattern, measured)), '\0');
  va_end(measured);
  std::vsnprintf(text.data(), text.size() + 1, pattern, values);
  va_end(values);
  return text;
}

}  // namespace base
