#pragma once
// The checksum at the end of a chunk. It also covers the counts that the table has for the chunk.
#include <array>
#include <cstring>
#include <optional>

#include "base/bytes.h"
#include "base/crc32c.h"

namespace lod::pmr {

inline std::uint32_t chunkChecksum(base::ByteView coded, std::uint32_t first_count, std::uint32_t second_count) {
  const auto counts = base::bitCast<std::array<std::uint8_t, 8>>(std::array{first_count, second_count});
  return base::crc32c(coded, base::crc32c(counts));
}

inline base::Bytes sealedChunk(base::Bytes coded, std::uint32_t first_count, std::uint32_t second_count) {
  const auto crc = base::bitCast<std::array<std::uint8_t, 4>>(chunkChecksum(coded, first_count, second_count));
  coded.insert(coded.end(), crc.begin(), crc.end());
  return coded;
}

/// The bytes before the checksum; nullopt where it does not match. Counts of 0 have no bytes and no checksum.
inline std::optional<base::ByteView> intactChunk(base::ByteView chunk, std::uint32_t first_count,
                                                 std::uint32_t second_count) {
  if (first_count == 0 && second_count == 0) return chunk.empty() ? std::optional(chunk) : std::nullopt;
  std::uint32_t crc = 0;
  if (chunk.size() < sizeof(crc)) return std::nullopt;
  const base::ByteView coded = chunk.first(chunk.size() - sizeof(crc));
  std::memcpy(&crc, chunk.data() + coded.size(), sizeof(crc));
  return crc == chunkChecksum(coded, first_count, second_count) ? std::optional(coded) : std::nullopt;
}

}  // namespace lod::pmr
