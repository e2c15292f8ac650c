#pragma once
// Numbers written for people, and blanks taken off texts.
#include <cstdint>
#include <string>
#include <string_view>

namespace base {

/// "12.3 MB": units of 1 000, from B to TB.
std::string formatBytes(std::uint64_t bytes);

/// 3024763 as "3,024,763".
std::string formatCount(std::uint64_t count, char separator = ',');

/// Removes spaces, tabs and line ends from both ends of the text.
std::string trimmed(std::string_view text);

}  // namespace base
