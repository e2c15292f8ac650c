#pragma once
// Numbers and colours written for people, and texts of people checked.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/image.h"

namespace base {

/// "12.3 MB": units of 1 000, from B to TB.
std::string formatBytes(std::uint64_t bytes);

/// 3024763 as "3,024,763".
std::string formatCount(std::uint64_t count, char separator = ',');

/// Removes spaces, tabs and line ends from both ends of the text.
std::string trimmed(std::string_view text);

/// Whether the text is UTF-8 without control characters, except those in `allowed`.
bool isPlainText(std::string_view text, std::string_view allowed = "");

/// The number of bytes, 1 to 4, of the UTF-8 sequence at the front of a text that is not empty; 0 for an invalid one:
/// overlong, cut off, a surrogate or above U+10FFFF.
std::size_t utf8Length(std::string_view text);
/// The character of a valid sequence of `length` bytes at the front of the text.
std::uint32_t utf8Character(std::string_view text, std::size_t length);

/// "#1a2b3c", in lower case.
std::string formatRgb(const Rgb& color);
/// Reads the same, in either case; nothing for any other text.
std::optional<Rgb> parseRgb(std::string_view text);

}  // namespace base
