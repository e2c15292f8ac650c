#include "plan/sight_cache.h"

#include "repository/sampling/grid.h"

namespace plan {
namespace {

constexpr std::uint32_t kSeen = 1, kHidden = 2;

}  // namespace

std::shared_ptr<SightCache::Row> SightCache::rowOf(const glm::uvec3& point) {
  const std::uint64_t code = repository::codeOfPoint(point);
  const std::lock_guard lock(mutex_);
  if (const auto* found = rows_.find(code)) return *found;
  auto row = std::make_shared<Row>(sight_.cellCount());
  rows_.insert(code, row, row->bytes());
  rows_.evict([code](std::uint64_t other) { return other == code; });
  return row;
}

bool SightCache::sees(Row& row, const glm::vec3& place, std::uint32_t cell) const {
  // Threads that find nothing compute the same verdict, so their order does not matter.
  std::atomic<std::uint32_t>& word = row.verdicts_[cell / Row::kPerWord];
  const auto shift = static_cast<std::uint32_t>(2 * (cell % Row::kPerWord));
  const std::uint32_t known = word.load(std::memory_order_relaxed) >> shift & 3U;
  if (known != 0) return known == kSeen;
  const bool is_seen = !sight_.isBlocked(sight_.cell(cell).place, place, clearance_);
  word.fetch_or((is_seen ? kSeen : kHidden) << shift, std::memory_order_relaxed);
  return is_seen;
}

std::uint64_t SightCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return rows_.bytes();
}

}  // namespace plan
