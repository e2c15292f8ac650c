#pragma once
// Vectors of a few lanes, as gcc and clang offer them. Arithmetic and comparisons work lane by lane, and `mask ? a : b`
// chooses per lane. A machine without such registers gets the same results from scalar instructions.
#include <array>
#include <cstdint>

/// Functions that take or return vectors become part of their caller: no ABI says how vectors of 32 bytes are passed,
/// and code that is compiled for several processors takes over the instructions of its caller this way.
#define LUMIGRID_ALWAYS_INLINE [[gnu::always_inline]] inline

namespace base {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));
using Uint4 = std::uint32_t __attribute__((vector_size(16)));
using Double2 = double __attribute__((vector_size(16)));
using Double4 = double __attribute__((vector_size(32)));
using Ushort8 = std::uint16_t __attribute__((vector_size(16)));
using Char8 = std::int8_t __attribute__((vector_size(8)));

/// Bit i is lane i of a comparison's result (−1 or 0).
LUMIGRID_ALWAYS_INLINE std::uint32_t bitsOf(Int4 comparison) {
#ifdef __SSE2__
  return static_cast<std::uint32_t>(__builtin_ia32_movmskps(reinterpret_cast<Float4>(comparison)));
#else
  return static_cast<std::uint32_t>((comparison[0] & 1) | (comparison[1] & 2) | (comparison[2] & 4) |
                                    (comparison[3] & 8));
#endif
}

/// Transposes four vectors of four lanes: lane j of result i is lane i of in[j].
template <class Vector>
LUMIGRID_ALWAYS_INLINE std::array<Vector, 4> transposed(const Vector* in) {
  const Vector low01 = __builtin_shufflevector(in[0], in[1], 0, 4, 1, 5);
  const Vector low23 = __builtin_shufflevector(in[2], in[3], 0, 4, 1, 5);
  const Vector high01 = __builtin_shufflevector(in[0], in[1], 2, 6, 3, 7);
  const Vector high23 = __builtin_shufflevector(in[2], in[3], 2, 6, 3, 7);
  return {__builtin_shufflevector(low01, low23, 0, 1, 4, 5), __builtin_shufflevector(low01, low23, 2, 3, 6, 7),
          __builtin_shufflevector(high01, high23, 0, 1, 4, 5), __builtin_shufflevector(high01, high23, 2, 3, 6, 7)};
}

}  // namespace base
