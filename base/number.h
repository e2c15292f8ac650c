#pragma once
// Numbers in text from outside.
#include <optional>
#include <string_view>

namespace base {

inline constexpr std::size_t kLongestNumber = 64;  ///< characters

/// A finite decimal number that is all of the text, such as "-12.5e3"; nothing for any other text and for what no
/// double holds. The nearest double, whatever the locale.
std::optional<double> parseNumber(std::string_view text);

}  // namespace base
