#pragma once
// Encoded messages of groups and images that several viewers get: whoever looks at the same places is sent the same
// bytes, read, checked and encoded once.
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <utility>

#include "base/bytes.h"
#include "repository/sampling/key.h"

namespace server {

/// The bytes of an encoded message, which several connections may be writing.
class SharedMessage {
 public:
  SharedMessage(base::Bytes bytes) : bytes_(std::make_shared<const base::Bytes>(std::move(bytes))) {}
  std::size_t size() const { return bytes_->size(); }
  const std::uint8_t* data() const { return bytes_->data(); }
  const base::Bytes& bytes() const { return *bytes_; }
  operator base::ByteView() const { return *bytes_; }

 private:
  std::shared_ptr<const base::Bytes> bytes_;
};

/// Look-ups in some caches, those that have ended by now included.
struct LookupCounts {
  std::atomic<std::uint64_t> hits{0}, misses{0};
};

/// Safe from any thread.
class MessageCache {
 public:
  /// The least recently used go when the messages have more bytes. `counts` is not null.
  explicit MessageCache(std::uint64_t max_bytes,
                        std::shared_ptr<LookupCounts> counts = std::make_shared<LookupCounts>())
      : max_shard_bytes_(max_bytes / kShards), counts_(std::move(counts)) {}

  static std::uint64_t keyOf(const repository::FaceKey& key) { return key.code(); }
  static std::uint64_t keyOf(std::uint32_t group) { return kGroup | group; }
  std::optional<SharedMessage> find(std::uint64_t key);
  /// A message larger than a shard of the cache is not kept.
  void add(std::uint64_t key, const SharedMessage& message);
  std::uint64_t bytes() const;
  const LookupCounts& counts() const { return *counts_; }

 private:
  static constexpr std::uint64_t kGroup = std::uint64_t{1} << 63;  // codes of keys have 63 bits
  static constexpr std::size_t kShards = 16;                       // so that threads seldom wait for each other
  using Entries = std::list<std::pair<std::uint64_t, SharedMessage>>;
  struct Shard {
    mutable std::mutex mutex;
    Entries entries;  // the last one used first
    std::unordered_map<std::uint64_t, Entries::iterator> places;
    std::uint64_t bytes = 0;
  };
  Shard& shardOf(std::uint64_t key);

  const std::uint64_t max_shard_bytes_;
  std::array<Shard, kShards> shards_;
  const std::shared_ptr<LookupCounts> counts_;
};

}  // namespace server
