#pragma once
// Counts the faces and groups that are sent to viewers, in bounded memory, until takeCounts() takes the counts away.
// Safe from any thread: counting is one look-up in a hash table, under a mutex that nobody holds for longer.
#include <cstdint>
#include <functional>
#include <mutex>
#include <unordered_map>

#include "repository/access.h"

namespace repository {

class AccessCounter {
 public:
  /// At most `max_keys` different faces and groups are kept at a time (about 40 bytes each); the others are
  /// `uncounted`. `when_full` is called once by the counting thread when there are that many; takeCounts() arms it
  /// again.
  explicit AccessCounter(std::size_t max_keys = 1'000'000, std::function<void()> when_full = nullptr);
  void addFace(const FaceKey& key);
  void addGroup(std::uint32_t group);
  /// Returns the counts since the last takeCounts(), with `since` and `until` 0, and starts again from zero.
  AccessCounts takeCounts();

 private:
  void addNumber(std::uint64_t number);

  const std::size_t max_keys_;
  const std::function<void()> when_full_;
  std::mutex mutex_;
  std::unordered_map<std::uint64_t, std::uint64_t> counts_;  // by code of the key, or kGroup | group
  std::uint64_t uncounted_ = 0;
  bool full_ = false;
};

}  // namespace repository
