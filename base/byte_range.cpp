#include "base/byte_range.h"

#include <algorithm>
#include <charconv>

#include "base/number.h"

namespace base {
namespace {

/// Digits only; a number over 2^64 - 1 counts as the largest, since a range may end anywhere past the body.
std::optional<std::uint64_t> parseSaturated(std::string_view text) {
  if (text.empty() || !std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return std::nullopt;
  std::uint64_t value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  return result.ec == std::errc::result_out_of_range ? UINT64_MAX : value;
}

}  // namespace

RangeRequest parseRange(std::string_view header, std::uint64_t size) {
  using Kind = RangeRequest::Kind;
  constexpr std::string_view kUnit = "bytes=";
  const RangeRequest whole{Kind::kWhole, 0, size};
  if (!header.starts_with(kUnit)) return whole;
  header.remove_prefix(kUnit.size());
  const std::size_t dash = header.find('-');
  if (dash == std::string_view::npos) return whole;
  const std::string_view before = header.substr(0, dash);
  const std::string_view after = header.substr(dash + 1);

  // "-n" asks for the last n bytes.
  if (before.empty()) {
    const auto suffix = parseSaturated(after);
    if (!suffix) return whole;
    const std::uint64_t length = std::min(*suffix, size);
    return length == 0 ? RangeRequest{Kind::kUnsatisfiable} : RangeRequest{Kind::kPart, size - length, length};
  }

  // "a-" and "a-b", b inclusive.
  const auto first = parseSaturated(before);
  const auto last = after.empty() ? std::optional<std::uint64_t>(UINT64_MAX) : parseSaturated(after);
  if (!first || !last || *last < *first) return whole;
  if (*first >= size) return {Kind::kUnsatisfiable};
  return {Kind::kPart, *first, std::min(*last, size - 1) - *first + 1};
}

std::string formatContentRange(const RangeRequest& range, std::uint64_t size) {
  const std::string part = range.kind == RangeRequest::Kind::kUnsatisfiable
                               ? "*"
                               : std::to_string(range.first) + "-" + std::to_string(range.first + range.length - 1);
  return "bytes " + part + "/" + std::to_string(size);
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
