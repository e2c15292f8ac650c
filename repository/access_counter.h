#pragma once
// Counts what is sent to viewers, in bounded memory, until somebody takes the counts away. From any thread; a count is
// one look into a hash table under a mutex that nobody holds for longer.
#include <cstdint>
#include <functional>
#include <mutex>
#include <unordered_map>

#include "repository/access.h"

namespace repository {

class AccessCounter {
 public:
  /// `most_keys`: different faces and groups kept at a time (about 40 bytes each); the others are `uncounted`.
  /// `when_full` is called once, by the thread that counts, when that many are there; takeCounts() arms it again.
  explicit AccessCounter(std::size_t most_keys = 1'000'000, std::function<void()> when_full = nullptr);
  void addFace(const FaceKey& key);
  void addGroup(std::uint32_t group);
  /// What came since the last takeCounts(); `since` and `until` are 0.
  AccessCounts takeCounts();

 private:
  void add(std::uint64_t number);

  const std::size_t most_keys_;
  const std::function<void()> when_full_;
  std::mutex mutex_;
  std::unordered_map<std::uint64_t, std::uint64_t> counts_;  // by key code, or kGroup + group
  std::uint64_t uncounted_ = 0;
  bool full_ = false;
};

}  // namespace repository
