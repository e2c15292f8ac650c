#include "base/content_range.h"

#include <cctype>

namespace base {

std::optional<std::uint64_t> parseDecimal(const std::string& text) {
  if (text.empty() || text.size() > 18) return std::nullopt;
  std::uint64_t number = 0;
  for (const char c : text) {
    if (c < '0' || c > '9') return std::nullopt;
    number = number * 10 + static_cast<std::uint64_t>(c - '0');
  }
  return number;
}

std::optional<ContentRange> parseContentRange(const std::string& text) {
  constexpr const char* kUnit = "bytes ";
  if (text.rfind(kUnit, 0) != 0) return std::nullopt;
  const std::size_t slash = text.find('/');
  if (slash == std::string::npos || slash < 6) return std::nullopt;
  const std::string bytes = text.substr(6, slash - 6);
  const std::string size = text.substr(slash + 1);

  ContentRange range;
  if (size != "*") {
    range.size = parseDecimal(size);
    if (!range.size) return std::nullopt;
  }
  if (bytes == "*") return range;
  const std::size_t dash = bytes.find('-');
  if (dash == std::string::npos) return std::nullopt;
  const auto first = parseDecimal(bytes.substr(0, dash));
  const auto last = parseDecimal(bytes.substr(dash + 1));
  if (!first || !last || *last < *first || (range.size && *last >= *range.size)) return std::nullopt;
  range.has_bytes = true;
  range.first = *first;
  range.last = *last;
  return range;
}

}  // namespace base
