#include "server/session/message_cache.h"

namespace server {

MessageCache::Shard& MessageCache::shardOf(std::uint64_t key) {
  // Neighbours in space differ in the middle bits of their keys; a multiplication spreads them (Knuth 1973, 6.4).
  return shards_[(key * 0x9E3779B97F4A7C15U) >> 60U];
}

std::optional<SharedMessage> MessageCache::find(std::uint64_t key) {
  Shard& shard = shardOf(key);
  const std::lock_guard lock(shard.mutex);
  const auto place = shard.places.find(key);
  if (place == shard.places.end()) {
    ++counts_->misses;
    return std::nullopt;
  }
  ++counts_->hits;
  shard.entries.splice(shard.entries.begin(), shard.entries, place->second);
  return place->second->second;
}

void MessageCache::add(std::uint64_t key, const SharedMessage& message) {
  if (message.size() > max_shard_bytes_) return;
  Shard& shard = shardOf(key);
  const std::lock_guard lock(shard.mutex);
  if (shard.places.count(key) != 0) return;  // another session was quicker
  shard.entries.emplace_front(key, message);
  shard.places.emplace(key, shard.entries.begin());
  shard.bytes += message.size();
  while (shard.bytes > max_shard_bytes_) {
    shard.bytes -= shard.entries.back().second.size();
    shard.places.erase(shard.entries.back().first);
    shard.entries.pop_back();
  }
}

std::uint64_t MessageCache::bytes() const {
  std::uint64_t sum = 0;
  for (const Shard& shard : shards_) {
    const std::lock_guard lock(shard.mutex);
    sum += shard.bytes;
  }
  return sum;
}

}  // namespace server
