#pragma once
// Reads numbers in text from outside.
#include <cstdint>
#include <optional>
#include <string_view>

namespace base {

inline constexpr std::size_t kMaxNumberLength = 64;  ///< characters; a double needs at most 24

/// Reads a text that is a finite decimal number as a whole, such as "-12.5e3", as the nearest double in any locale;
/// nullopt for any other text and for numbers that no double holds.
std::optional<double> parseNumber(std::string_view text);

/// Reads a number of 1 to 18 decimal digits, so below 2^63; nullopt for any other text.
std::optional<std::uint64_t> parseDecimal(std::string_view text);

}  // namespace base
