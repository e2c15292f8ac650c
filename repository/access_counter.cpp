#include "repository/access_counter.h"

#include <algorithm>

namespace repository {
namespace {

constexpr std::uint64_t kGroup = std::uint64_t{1} << 63;  // codes of keys have 63 bits

}  // namespace

AccessCounter::AccessCounter(std::size_t max_keys, std::function<void()> when_full)
    : max_keys_(max_keys), when_full_(std::move(when_full)) {}

void AccessCounter::addFace(const FaceKey& key) {
  addNumber(key.code());
}
void AccessCounter::addGroup(std::uint32_t group) {
  addNumber(kGroup | group);
}

void AccessCounter::addNumber(std::uint64_t number) {
  bool became_full = false;
  {
    const std::lock_guard lock(mutex_);
    if (const auto it = counts_.find(number); it != counts_.end()) {
      ++it->second;
      return;
    }
    if (counts_.size() < max_keys_)
      counts_.emplace(number, 1);
    else
      ++uncounted_;
    if (counts_.size() >= max_keys_ && !full_) full_ = became_full = true;
  }
  if (became_full && when_full_) when_full_();
}

AccessCounts AccessCounter::takeCounts() {
  std::unordered_map<std::uint64_t, std::uint64_t> taken;
  AccessCounts counts;
  {
    const std::lock_guard lock(mutex_);
    taken.swap(counts_);
    counts.uncounted = std::exchange(uncounted_, 0);
    full_ = false;
  }
  for (const auto& [number, count] : taken) {
    if ((number & kGroup) != 0)
      counts.groups.emplace_back(static_cast<std::uint32_t>(number & ~kGroup), count);
    else
      counts.faces.emplace_back(*FaceKey::fromCode(number), count);
  }
  std::sort(counts.faces.begin(), counts.faces.end());
  std::sort(counts.groups.begin(), counts.groups.end());
  return counts;
}

}  // namespace repository
