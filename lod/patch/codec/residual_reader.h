#pragma once
// Reads planes of residuals (residuals.h), on any machine or with AVX2 and AVX-512.
#include <cstdint>

#include "base/bytes.h"

namespace lod::patch::codec {

/// Where a reader works, for one plane of `groups` groups.
struct ResidualRoom {
  std::uint8_t* widths = nullptr;  ///< a nibble per group and 16 bytes more
  std::uint8_t* places = nullptr;  ///< a byte per number and 80 more
};

/// Reads the residuals of the plane at `at`, in whole groups, and moves `at` behind it. False when the plane runs past
/// the end, when a group has too many unary bits, or when the plane has other unary bytes than its groups fill. `in`
/// must be readable 16 bytes past its end. `out`: 16 numbers per group.
using ResidualReader = bool (*)(base::ByteView in, std::size_t& at, std::size_t groups, const ResidualRoom& room,
                                std::uint32_t* out);

bool readResiduals(base::ByteView in, std::size_t& at, std::size_t groups, const ResidualRoom& room,
                   std::uint32_t* out);
#if defined(__x86_64__)
/// The same with vectors, for machines that have these instructions.
bool readResidualsByAvx2(base::ByteView in, std::size_t& at, std::size_t groups, const ResidualRoom& room,
                         std::uint32_t* out);
bool readResidualsByAvx512(base::ByteView in, std::size_t& at, std::size_t groups, const ResidualRoom& room,
                           std::uint32_t* out);
#endif

}  // namespace lod::patch::codec
