#pragma once
// Decodes a leaf at a level.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "base/bytes.h"
#include "lod/pmr/chunk_order.h"
#include "lod/pmr/format.h"
#include "lod/pmr/stream.h"

namespace lod::pmr {

/// A bit for each chunk of a leaf (chunk_order.h).
using ChunkMask = std::uint32_t;
constexpr ChunkMask chunkBit(std::uint32_t chunk) {
  return ChunkMask{1} << chunk;
}
/// The chunks that a level is decoded from.
constexpr ChunkMask chunksOfLevel(std::uint32_t level) {
  return (chunkBit(kLevels) - chunkBit(level)) | chunkBit(kLevels + level);
}

struct ChunkPlace {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;
};
ChunkPlace placeOf(const Leaf& leaf, std::uint32_t chunk);
/// Whether the bytes are those that were written for this chunk.
bool isIntact(const Leaf& leaf, std::uint32_t chunk, base::ByteView bytes);

/// Memory of a leaf's picture.
std::uint64_t pictureBytes(const Leaf& leaf, std::uint32_t level);

/// A picture, or else the chunk that is damaged.
struct DecodedLeaf {
  std::shared_ptr<const LeafPicture> picture;
  std::uint32_t damaged_chunk = 0;
};
/// Returns the bytes of a chunk, valid until the next call; nullopt where they cannot be read.
using ChunkBytes = std::function<std::optional<base::ByteView>(std::uint32_t chunk)>;
DecodedLeaf decodeLeaf(const Header& header, const Leaf& leaf, std::uint32_t number, std::uint32_t level,
                       const ChunkBytes& bytes_of);

}  // namespace lod::pmr
