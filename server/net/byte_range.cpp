#include "server/net/byte_range.h"

#include <algorithm>
#include <charconv>
#include <optional>

namespace server {
namespace {

/// Digits only; numbers over 2^64 count as the largest.
std::optional<std::uint64_t> number(std::string_view text) {
  if (text.empty() || !std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; }))
    return std::nullopt;
  std::uint64_t value = 0;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  return result.ec == std::errc::result_out_of_range ? UINT64_MAX : value;
}

}  // namespace

ByteRange parseByteRange(std::string_view header, std::uint64_t size) {
  using Kind = ByteRange::Kind;
  constexpr std::string_view kUnit = "bytes=";
  const ByteRange whole{Kind::kWhole, 0, size};
  if (!header.starts_with(kUnit)) return whole;
  header.remove_prefix(kUnit.size());
  const std::size_t dash = header.find('-');
  if (dash == std::string_view::npos) return whole;
  const std::string_view before = header.substr(0, dash);
  const std::string_view after = header.substr(dash + 1);

  // "-n": the last n bytes.
  if (before.empty()) {
    const auto suffix = number(after);
    if (!suffix) return whole;
    const std::uint64_t length = std::min(*suffix, size);
    return length == 0 ? ByteRange{Kind::kUnsatisfiable} : ByteRange{Kind::kPart, size - length, length};
  }

  // "a-" and "a-b", b inclusive.
  const auto first = number(before);
  const auto last = after.empty() ? std::optional<std::uint64_t>(UINT64_MAX) : number(after);
  if (!first || !last || *last < *first) return whole;
  if (*first >= size) return {Kind::kUnsatisfiable};
  return {Kind::kPart, *first, std::min(*last, size - 1) - *first + 1};
}

std::string contentRange(const ByteRange& range, std::uint64_t size) {
  std::string text = "bytes ";
  if (range.kind == ByteRange::Kind::kUnsatisfiable) {
    text += '*';
  } else {
    text += std::to_string(range.first);
    text += '-';
    text += std::to_string(range.first + range.length - 1);
  }
  text += '/';
  text += std::to_string(size);
  return text;
}

}  // namespace server
