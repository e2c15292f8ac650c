#pragma once
// The order in which the chunks of all leaves lie in the file (docs/formats/pmr.md).
//
// First comes the coarsest level of each leaf. The other levels lie in groups of neighbouring leaves, and within a
// group level by level: neighbours are mostly wanted at the same level, and then their chunks come with one request.
#include <algorithm>
#include <cstdint>

#include "lod/pmr/format.h"

namespace lod::pmr {

/// The chunks of a leaf have numbers: the points of class c have number c, the triangles of level l number kLevels + l.
inline constexpr std::uint32_t kLeafChunks = 2 * kLevels;
/// Leaves of a group. A choice: a view of all leaves of a fine level needs a request or two for a group, and a view of
/// few leaves reads little in vain between their coarse chunks.
inline constexpr std::uint32_t kGroupLeaves = 32;

/// A chunk of the file.
struct ChunkId {
  std::uint32_t leaf = 0, chunk = 0;
  friend bool operator==(const ChunkId&, const ChunkId&) = default;
};

class ChunkOrder {
 public:
  explicit ChunkOrder(std::uint32_t leaves) : leaves_(leaves) {}

  std::uint64_t chunks() const { return std::uint64_t{leaves_} * kLeafChunks; }
  /// The first chunks are those of the base section.
  std::uint64_t baseChunks() const { return std::uint64_t{leaves_} * kBaseChunks; }

  /// The chunk at a place, 0 … chunks() − 1, in the file.
  ChunkId at(std::uint64_t place) const {
    if (place < baseChunks()) return {static_cast<std::uint32_t>(place / kBaseChunks), chunkOf(place % kBaseChunks)};
    const std::uint64_t fine = place - baseChunks();
    const auto first = static_cast<std::uint32_t>(fine / (kFineChunks * kGroupLeaves)) * kGroupLeaves;
    const std::uint64_t in_group = fine - std::uint64_t{first} * kFineChunks;
    const std::uint32_t size = groupSize(first);
    return {first + static_cast<std::uint32_t>(in_group % size), chunkOf(kBaseChunks + in_group / size)};
  }
  std::uint64_t placeOf(const ChunkId& id) const {
    const std::uint64_t order = orderOf(id.chunk);
    if (order < kBaseChunks) return std::uint64_t{id.leaf} * kBaseChunks + order;
    const std::uint32_t first = id.leaf / kGroupLeaves * kGroupLeaves;
    return baseChunks() + std::uint64_t{first} * kFineChunks + (order - kBaseChunks) * groupSize(first) + id.leaf -
           first;
  }

 private:
  static constexpr std::uint32_t kBaseChunks = 2;
  static constexpr std::uint32_t kFineChunks = kLeafChunks - kBaseChunks;

  std::uint32_t groupSize(std::uint32_t first) const { return std::min(kGroupLeaves, leaves_ - first); }
  // A leaf's chunks in the order of the file: points and triangles of the coarsest level, then the points of all other
  // classes, then the triangles of all other levels.
  static std::uint32_t chunkOf(std::uint64_t order) {
    if (order < kBaseChunks) return order == 0 ? kCoarsest : kLevels + kCoarsest;
    const auto fine = static_cast<std::uint32_t>(order - kBaseChunks);
    return fine < kCoarsest ? kCoarsest - 1 - fine : kLevels + 2 * kCoarsest - 1 - fine;
  }
  static std::uint32_t orderOf(std::uint32_t chunk) {
    const std::uint32_t level = chunk % kLevels;
    if (level == kCoarsest) return chunk < kLevels ? 0 : 1;
    return kBaseChunks + (chunk < kLevels ? 0 : kCoarsest) + kCoarsest - 1 - level;
  }

  std::uint32_t leaves_;
};

}  // namespace lod::pmr
