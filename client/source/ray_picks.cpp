#include "client/source/ray_picks.h"

#include <algorithm>
#include <utility>

namespace client {
namespace {

PickAnswer answerOf(const std::optional<lod::patch::RayHit>& hit) {
  PickAnswer answer;
  answer.kind = hit ? PickAnswer::Kind::kHit : PickAnswer::Kind::kNone;
  if (!hit) return answer;
  answer.point = hit->point;
  answer.normal = hit->front ? hit->normal : -hit->normal;
  answer.accuracy = hit->accuracy;
  return answer;
}

}  // namespace

void RayPicks::addRay(std::uint32_t id, const lod::patch::Ray& ray) {
  if (rays_.size() >= kMaxQueue)
    answered_.push_back({id, {}});
  else
    rays_.push_back({id, ray});
}

void RayPicks::keepBlock(std::uint32_t group, base::ByteView block) {
  if (!waiting()) return;
  if (!blocks_.emplace(group, base::Bytes(block.begin(), block.end())).second) return;
  block_bytes_ += block.size();
}

/// Drops the ray's blocks too: the next ray may lie elsewhere, and what it shares comes from the session's cache.
void RayPicks::finishFirst(const PickAnswer& found) {
  answered_.push_back({rays_.front().id, found});
  rays_.pop_front();
  needed_.clear();
  blocks_.clear();
  block_bytes_ = 0;
}

void RayPicks::castWaiting(const lod::patch::Hierarchy& hierarchy, const lod::patch::BlockSource& elsewhere,
                           const ReadRecord& read_record) {
  const lod::patch::BlockSource blocks = [&](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
    if (const auto kept = blocks_.find(group); kept != blocks_.end())
      return std::optional<base::ByteView>(kept->second);
    return elsewhere(group);
  };
  while (waiting()) {
    auto cast = lod::patch::castRay(hierarchy, rays_.front().ray, blocks);
    if (!cast) {
      problem_ = cast.error().message;
      finishFirst({});
      continue;
    }
    if (cast->needed.empty()) {
      finishFirst(answerOf(cast->hit));
      continue;
    }
    needed_ = std::move(cast->needed);
    needed_.resize(std::min(needed_.size(), kGroupsAhead));
    bool read_any = false;
    bool broken = block_bytes_ > kMaxBytes;
    for (const std::uint32_t group : needed_) {
      if (group < hierarchy.groups.size() && hierarchy.isKnown(group)) continue;
      const RecordStatus record = read_record(group);
      read_any |= record == RecordStatus::kHere;
      broken |= record == RecordStatus::kBroken;
    }
    if (broken)
      finishFirst({});
    else if (!read_any)
      return;
  }
}

void RayPicks::giveUp() {
  while (waiting()) finishFirst({});
}

}  // namespace client
