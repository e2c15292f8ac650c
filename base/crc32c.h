#pragma once
// CRC-32C (Castagnoli, RFC 3720 appendix B.4), the checksum of every stored block and value.
#include <cstdint>

#include "base/bytes.h"

namespace base {

/// CRC-32C of `bytes`; `seed` is the CRC of what came before (0 at the start). crc32c("123456789") is 0xE3069283.
std::uint32_t crc32c(ByteView bytes, std::uint32_t seed = 0);

/// The same by tables, as crc32c computes it on a processor without an instruction for it.
std::uint32_t crc32cByTables(ByteView bytes, std::uint32_t seed = 0);

}  // namespace base
