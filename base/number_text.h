#pragma once
// Numbers from text, without the library's strtod: that brings arithmetic of 128 bits into a page's WebAssembly.
#include <optional>
#include <string_view>

namespace base {

/// All of the text as one decimal number: "-12.5", ".5", "3.", "+1.25e-3". Nothing where it is something else. Exactly
/// what strtod gives for up to 15 digits and exponents within ±22 (of the digits as a whole number), else within an ulp
/// or two; too large is an infinity, too small 0.
std::optional<double> readNumber(std::string_view text);

}  // namespace base
