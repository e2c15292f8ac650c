#include "lod/pmr/leaf_cache.h"

#include <algorithm>
#include <utility>

namespace lod::pmr {
namespace {

// When memory is full, one part in so many is freed at a time. A choice: larger parts drop more that comes back into
// view, smaller ones sort leaves by their last use more often.
constexpr std::uint64_t kFreedPart = 64;

std::uint64_t keyOf(std::uint32_t leaf, std::uint32_t chunk) {
  return std::uint64_t{leaf} * kLeafChunks + chunk;
}

}  // namespace

std::shared_ptr<const LeafPicture> LeafState::pictureAt(std::uint32_t level) const {
  for (const auto& picture : pictures)
    if (picture && picture->level == level) return picture;
  return nullptr;
}

std::shared_ptr<const LeafPicture> LeafState::bestPicture(std::uint32_t level) const {
  for (std::uint32_t l = level; l < kLevels; ++l)
    if (auto picture = pictureAt(l)) return picture;
  for (std::uint32_t l = std::min(level, kLevels); l-- > 0;)
    if (auto picture = pictureAt(l)) return picture;
  return nullptr;
}

LeafCache::LeafCache(std::span<const Leaf> leaves, std::uint64_t limit, bool is_local)
    : leaves_(leaves), limit_(limit), is_local_(is_local), states_(leaves.size()) {
  for (std::size_t i = 0; i < leaves.size(); ++i)
    for (std::uint32_t chunk = 0; chunk < kLeafChunks; ++chunk)
      if (is_local || placeOf(leaves[i], chunk).bytes == 0) states_[i].present |= chunkBit(chunk);
}

std::uint64_t LeafCache::costOf(std::uint32_t leaf, std::uint32_t level) const {
  const Leaf& of = leaves_[leaf];
  std::uint64_t cost = pictureBytes(of, level);
  if (level != kCoarsest) cost += pictureBytes(of, kCoarsest);
  if (is_local_) return cost;
  for (std::uint32_t c = level; c < kLevels; ++c) cost += of.levels[c].point_bytes;
  cost += of.levels[level].triangle_bytes;
  if (level != kCoarsest) cost += of.levels[kCoarsest].triangle_bytes;
  return cost;
}

void LeafCache::keepChunk(std::uint32_t leaf, std::uint32_t chunk, base::ByteView bytes) {
  states_[leaf].present |= chunkBit(chunk);
  chunks_[keyOf(leaf, chunk)].assign(bytes.begin(), bytes.end());
  bytes_ += bytes.size();
}

base::ByteView LeafCache::chunk(std::uint32_t leaf, std::uint32_t chunk) const {
  const auto found = chunks_.find(keyOf(leaf, chunk));
  return found != chunks_.end() ? base::ByteView(found->second) : base::ByteView();
}

void LeafCache::giveUp(std::uint32_t leaf, std::uint32_t chunk) {
  dropChunks(leaf, chunkBit(chunk));
  states_[leaf].present &= ~chunkBit(chunk);
  states_[leaf].given_up |= chunkBit(chunk);
}

void LeafCache::keepPicture(std::shared_ptr<const LeafPicture> picture) {
  LeafState& state = states_[picture->leaf];
  auto* place = &state.pictures[0];
  if (*place && state.pictures[1] && (*place)->level == state.shown) place = &state.pictures[1];
  if (*place && !state.pictures[1]) place = &state.pictures[1];
  dropPicture(picture->leaf, *place);
  leaves_with_picture_ += state.hasPicture() ? 0 : 1;
  bytes_ += pictureBytes(leaves_[picture->leaf], picture->level);
  *place = std::move(picture);
}

void LeafCache::dropChunks(std::uint32_t leaf, ChunkMask chunks) {
  for (std::uint32_t chunk = 0; chunk < kLeafChunks; ++chunk) {
    const auto found = (chunks & chunkBit(chunk)) != 0 ? chunks_.find(keyOf(leaf, chunk)) : chunks_.end();
    if (found == chunks_.end()) continue;
    bytes_ -= found->second.size();
    chunks_.erase(found);
    states_[leaf].present &= ~chunkBit(chunk);
  }
}

void LeafCache::dropPicture(std::uint32_t leaf, std::shared_ptr<const LeafPicture>& picture) {
  if (!picture) return;
  bytes_ -= pictureBytes(leaves_[leaf], picture->level);
  picture.reset();
  leaves_with_picture_ -= states_[leaf].hasPicture() ? 0 : 1;
}

void LeafCache::dropLeaf(std::uint32_t leaf) {
  dropChunks(leaf, chunkBit(kLeafChunks) - 1);
  for (auto& picture : states_[leaf].pictures) dropPicture(leaf, picture);
}

void LeafCache::evict(std::uint32_t frame) {
  if (bytes_ <= limit_) return;
  evictUnseen(frame, limit_ - limit_ / kFreedPart);
  for (const bool also_shown : {false, true})
    for (std::uint32_t leaf = 0; leaf < states_.size() && bytes_ > limit_; ++leaf)
      if (states_[leaf].used >= frame) evictSurplus(leaf, also_shown);
}

void LeafCache::evictUnseen(std::uint32_t frame, std::uint64_t target) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unseen;  // frame of the last use, leaf
  for (std::uint32_t leaf = 0; leaf < states_.size(); ++leaf)
    if (states_[leaf].used < frame) unseen.emplace_back(states_[leaf].used, leaf);
  std::sort(unseen.begin(), unseen.end());
  for (const auto& [used, leaf] : unseen) {
    if (bytes_ <= target) return;
    dropLeaf(leaf);
  }
}

void LeafCache::evictSurplus(std::uint32_t leaf, bool also_shown) {
  LeafState& state = states_[leaf];
  const std::uint32_t planned = state.planned;
  if (planned == kNoLevel) {
    if (also_shown) dropLeaf(leaf);
    return;
  }
  dropChunks(leaf, ~(chunksOfLevel(planned) | chunksOfLevel(kCoarsest)));
  for (auto& picture : state.pictures) {
    const bool needed = !picture || picture->level == planned || picture->level == kCoarsest;
    if (!needed && (also_shown || picture->level != state.shown)) dropPicture(leaf, picture);
  }
}

}  // namespace lod::pmr
