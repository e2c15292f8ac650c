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
    : nodes_(nodes), limit_(limit), is_local_(is_local), states_(2 * nodes.size()) {}

bool NodeCache::has(std::uint32_t part) const {
  const NodeState& state = states_[part];
  if (state.is_given_up) return false;
  return state.picture || state.caster || !state.block.empty() || is_local_ || placeOf(part).bytes == 0;
}

std::uint64_t NodeCache::costOf(std::uint32_t part) const {
  const std::uint64_t known = states_[part].known_cost;
  const Node& node = nodes_[nodeOf(part)];
  const std::uint64_t guess = isCaster(part) ? guessedCasterBytes(node) : guessedPictureBytes(node);
  return std::max<std::uint64_t>(known != 0 ? known : guess, placeOf(part).bytes);
}

void NodeCache::keepBlock(std::uint32_t part, base::ByteView bytes, std::uint32_t frame) {
  states_[part].block.assign(bytes.begin(), bytes.end());
  states_[part].kept = frame;
  bytes_ += bytes.size();
}

/// The part is decoded and takes so many bytes.
void NodeCache::keep(std::uint32_t part, std::uint64_t bytes) {
  drop(part);
  states_[part].known_cost = static_cast<std::uint32_t>(bytes);
  bytes_ += bytes;
}

void NodeCache::keepPicture(std::shared_ptr<const NodePicture> picture) {
  const std::uint32_t part = picture->node;
  keep(part, pictureBytes(*picture));
  states_[part].picture = std::move(picture);
  ++pictures_;
}

void NodeCache::keepCaster(std::shared_ptr<const CasterPicture> caster) {
  const std::uint32_t part = casterOf(caster->node);
  keep(part, casterBytes(*caster));
  states_[part].caster = std::move(caster);
}

void NodeCache::giveUp(std::uint32_t part) {
  drop(part);
  states_[part].is_given_up = true;
}

void NodeCache::drop(std::uint32_t part) {
  NodeState& state = states_[part];
  bytes_ -= state.block.size();
  state.block = {};
  if (!state.picture && !state.caster) return;
  bytes_ -= state.known_cost;
  pictures_ -= state.picture ? 1 : 0;
  state.picture.reset();
  state.caster.reset();
}

void NodeCache::evict(std::uint32_t frame, std::span<const std::uint32_t> pictures,
                      std::span<const std::uint32_t> casters) {
  if (bytes_ <= limit_) return;
  evictUnused(frame, limit_ - limit_ / kFreedPart);
  const auto evictPlanned = [this](std::span<const std::uint32_t> plan, bool refined_only) {
    for (std::size_t i = plan.size(); i-- > 0 && bytes_ > limit_;)
      if (!refined_only || states_[plan[i]].is_refined) drop(plan[i]);
  };
  evictPlanned(pictures, true);
  evictPlanned(casters, false);
  evictPlanned(pictures, false);
}

void NodeCache::evictUnused(std::uint32_t frame, std::uint64_t target) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> unused;  // frame of the last use, part
  for (std::uint32_t part = 0; part < states_.size(); ++part) {
    const NodeState& state = states_[part];
    const std::uint32_t last = std::max({state.used, state.needed, state.kept});
    if (last < frame && (state.picture || state.caster || !state.block.empty())) unused.emplace_back(last, part);
  }
  // The finer ones of equally old parts go first.
  std::sort(unused.begin(), unused.end(),
            [](const auto& a, const auto& b) { return a.first != b.first ? a.first < b.first : a.second > b.second; });
  for (const auto& [last, part] : unused) {
    if (bytes_ <= target) return;
    drop(part);
  }
}

}  // namespace lod::hlod
