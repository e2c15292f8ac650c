#pragma once
// Keeps the chunks and pictures of leaves up to a number of bytes.
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "lod/pmr/leaf_picture.h"

namespace lod::pmr {

inline constexpr std::uint32_t kNoLevel = 255;

/// State of a leaf.
struct LeafState {
  ChunkMask present = 0;            ///< chunks that are here, and those without bytes
  ChunkMask requested = 0;          ///< chunks under way
  ChunkMask given_up = 0;           ///< damaged ones
  ChunkMask wanted = 0;             ///< chunks that the frame `used` misses
  std::uint32_t used = 0;           ///< the last frame that has seen the leaf
  std::uint8_t planned = kNoLevel;  ///< level that this frame has memory for
  std::uint8_t shown = kNoLevel;
  /// At most two pictures of different levels.
  std::array<std::shared_ptr<const LeafPicture>, 2> pictures;

  bool has(std::uint32_t level) const { return (chunksOfLevel(level) & ~present) == 0; }
  bool canHave(std::uint32_t level) const { return (chunksOfLevel(level) & given_up) == 0; }
  bool hasPicture() const { return pictures[0] || pictures[1]; }
  /// Null where there is none.
  std::shared_ptr<const LeafPicture> pictureAt(std::uint32_t level) const;
  /// The finest picture no finer than `level`, or else the coarsest; null where there is none.
  std::shared_ptr<const LeafPicture> bestPicture(std::uint32_t level) const;
};

class LeafCache {
 public:
  /// `is_local`: all chunks can be read at any time, and none is kept.
  LeafCache(std::span<const Leaf> leaves, std::uint64_t limit, bool is_local);

  LeafState& operator[](std::uint32_t leaf) { return states_[leaf]; }
  const LeafState& operator[](std::uint32_t leaf) const { return states_[leaf]; }
  std::span<const LeafState> states() const { return states_; }
  std::uint64_t bytes() const { return bytes_; }
  std::uint64_t leavesWithPicture() const { return leaves_with_picture_; }
  std::uint64_t limit() const { return limit_; }

  /// Memory of a leaf shown at a level: its chunks and picture, and those of the coarsest level.
  std::uint64_t costOf(std::uint32_t leaf, std::uint32_t level) const;

  void keepChunk(std::uint32_t leaf, std::uint32_t chunk, base::ByteView bytes);
  /// The bytes of a present chunk.
  base::ByteView chunk(std::uint32_t leaf, std::uint32_t chunk) const;
  /// Forgets a damaged chunk for good.
  void giveUp(std::uint32_t leaf, std::uint32_t chunk);
  /// Keeps a picture. Where the leaf has two others, the one that is not shown makes room.
  void keepPicture(std::shared_ptr<const LeafPicture> picture);

  /// Drops what was not used for the longest time until the limit is kept: whole leaves that frame `frame` has not
  /// seen, then what seen ones have beyond their planned level, last pictures that are shown in its place.
  void evict(std::uint32_t frame);

 private:
  void dropChunks(std::uint32_t leaf, ChunkMask chunks);
  void dropPicture(std::uint32_t leaf, std::shared_ptr<const LeafPicture>& picture);
  void dropLeaf(std::uint32_t leaf);
  void evictUnseen(std::uint32_t frame, std::uint64_t target);
  void evictSurplus(std::uint32_t leaf, bool also_shown);

  std::span<const Leaf> leaves_;
  const std::uint64_t limit_;
  const bool is_local_;
  std::vector<LeafState> states_;
  std::unordered_map<std::uint64_t, base::Bytes> chunks_;  // by leaf · kLeafChunks + chunk
  std::uint64_t bytes_ = 0;
  std::uint64_t leaves_with_picture_ = 0;
};

}  // namespace lod::pmr
