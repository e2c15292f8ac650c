#include "base/text.h"

#include <array>
#include <charconv>
#include <cstdio>

#include "base/format_text.h"

namespace base {

std::string formatBytes(std::uint64_t bytes) {
  constexpr std::array<const char*, 5> kUnits{"B", "kB", "MB", "GB", "TB"};
  double value = static_cast<double>(bytes);
  std::size_t unit = 0;
  for (; value >= 1000.0 && unit + 1 < kUnits.size(); ++unit) value /= 1000.0;
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), unit == 0 ? "%.0f %s" : "%.1f %s", value, kUnits[unit]);
  return text.data();
}

std::string formatCount(std::uint64_t count, char separator) {
  std::string text = std::to_string(count);
  for (std::size_t i = text.size(); i > 3; i -= 3) text.insert(i - 3, 1, separator);
  return text;
}

std::string trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  const auto begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1));
}

bool isPlainText(std::string_view text, std::string_view allowed) {
  while (!text.empty()) {
    const std::size_t length = utf8Length(text);
    if (length == 0) return false;
    const auto first = static_cast<unsigned char>(text.front());
    if ((first < 0x20 || first == 0x7F) && allowed.find(text.front()) == std::string_view::npos) return false;
    text.remove_prefix(length);
  }
  return true;
}

std::size_t utf8Length(std::string_view text) {
  const auto at = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = at(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t i = 1; i < length; ++i)
    if ((at(i) & 0xC0U) != 0x80U) return 0;
  const unsigned char second = at(1);
  if ((first == 0xE0 && second < 0xA0) || (first == 0xED && second > 0x9F)) return 0;
  if ((first == 0xF0 && second < 0x90) || (first == 0xF4 && second > 0x8F)) return 0;
  return length;
}

std::uint32_t utf8Character(std::string_view text, std::size_t length) {
  const auto first = static_cast<unsigned char>(text[0]);
  if (length == 1) return first;
  std::uint32_t character = first & (0x7FU >> length);
  for (std::size_t i = 1; i < length; ++i) character = (character << 6) | (static_cast<unsigned char>(text[i]) & 0x3FU);
  return character;
}

std::string formatRgb(const Rgb& color) {
  return formatText("#%02x%02x%02x", unsigned{color[0]}, unsigned{color[1]}, unsigned{color[2]});
}

std::optional<Rgb> parseRgb(std::string_view text) {
  Rgb color{};
  if (text.size() != 1 + 2 * color.size() || text.front() != '#') return std::nullopt;
  for (std::size_t c = 0; c < color.size(); ++c) {
    const char* digits = text.data() + 1 + 2 * c;
    const auto [end, error] = std::from_chars(digits, digits + 2, color[c], 16);
    if (error != std::errc{} || end != digits + 2) return std::nullopt;
  }
  return color;
}

}  // namespace base
