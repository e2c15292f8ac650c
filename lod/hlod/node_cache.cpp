#include "lod/hlod/node_cache.h"

#include <algorithm>
#include <utility>

#include "lod/hlod/node_picture.h"

namespace lod::hlod {
namespace {

// When memory is full, one part in so many is freed at a time. A choice: larger parts drop more that comes back into
// view, smaller ones sort nodes by their last use more often.
constexpr std::uint64_t kFreedPart = 64;

}  // namespace

NodeCache::NodeCache(std::span<const Node> nodes, std::uint64_t limit, bool is_local)
    : nodes_(nodes), limit_(limit), is_local_(is_local), states_(nodes.size()) {}

bool NodeCache::has(std::uint32_t node) const {
  const NodeState& state = states_[node];
  if (state.is_given_up) return false;
  return state.picture || !state.block.empty() || is_local_ || nodes_[node].picture.bytes == 0;
}

std::uint64_t NodeCache::costOf(std::uint32_t node) const {
  const std::uint64_t known = states_[node].known_cost;
  return std::max<std::uint64_t>(known != 0 ? known : guessedPictureBytes(nodes_[node]), nodes_[node].picture.bytes);
}

void NodeCache::keepBlock(std::uint32_t node, base::ByteView bytes) {
  states_[node].block.assign(bytes.begin(), bytes.end());
  bytes_ += bytes.size();
}

void NodeCache::keepPicture(std::shared_ptr<const NodePicture> picture) {
  const std::uint32_t node = picture->node;
  drop(node);
  const std::uint64_t bytes = pictureBytes(*picture);
  states_[node].known_cost = static_cast<std::uint32_t>(bytes);
  states_[node].picture = std::move(picture);
  bytes_ += bytes;
  ++pictures_;
}

void NodeCache::giveUp(std::uint32_t node) {
  drop(node);
  states_[node].is_given_up = true;
}

void NodeCache::drop(std::uint32_t node) {
  NodeState& state = states_[node];
  bytes_ -= state.block.size();
  state.block = {};
  if (!state.picture) return;
  bytes_ -= state.known_cost;
  state.picture.reset();
  --pictures_;
}

void NodeCache::evict(std::uint32_t frame, std::span<const std::uint32_t> plan) {
  if (bytes_ <= limit_) return;
  evictUnused(frame, limit_ - limit_ / kFreedPart);
  for (const bool also_final : {false, true})
    for (std::size_t i = plan.size(); i-- > 0 && bytes_ > limit_;)
      if (also_final || states_[plan[i]].is_refined) drop(plan[i]);
}

void NodeCache::evictUnused(std::uint32_t frame, std::uint64_t target) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unused;  // frame of the last use, node
  for (std::uint32_t node = 0; node < states_.size(); ++node) {
    const NodeState& state = states_[node];
    if (state.used < frame && (state.picture || !state.block.empty())) unused.emplace_back(state.used, node);
  }
  // The finer ones of those that are equally old go first.
  std::sort(unused.begin(), unused.end(),
            [](const auto& a, const auto& b) { return a.first != b.first ? a.first < b.first : a.second > b.second; });
  for (const auto& [used, node] : unused) {
    if (bytes_ <= target) return;
    drop(node);
  }
}

}  // namespace lod::hlod
