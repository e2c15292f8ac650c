#pragma once
// Which of its errors a patch hierarchy is refined by (docs/decisions/visible-error.md).
#include <cstdint>

namespace base {

enum class ErrorMeasure : std::uint8_t {
  kVisible,  ///< as far as a person sees the difference, colours included
  kShape,    ///< the same of shape alone, where images bring the colours
  kBound,    ///< the proved bound: no point is farther off
};
inline constexpr std::uint8_t kErrorMeasures = 3;

}  // namespace base
