#pragma once
// The header Content-Range (RFC 9110, section 14.4): "bytes 0-99/1234", "bytes 0-99/*", "bytes */1234".
#include <cstdint>
#include <optional>
#include <string>

namespace base {

struct ContentRange {
  bool has_bytes = false;  ///< false for "bytes */1234"
  std::uint64_t first = 0, last = 0;
  std::optional<std::uint64_t> size;  ///< of the whole object
};

/// Nothing for anything else, also where last < first or last >= size.
std::optional<ContentRange> parseContentRange(const std::string& text);

/// Digits only, below 2^63.
std::optional<std::uint64_t> parseDecimal(const std::string& text);

}  // namespace base
