#pragma once
// Keeps pieces of remote objects on the local disk, in an LMDB of bounded size that evicts the least recently used
// piece first (docs/formats/cache.md). The cache survives restarts and kill -9, and several processes may share it. It
// discards damaged pieces and never returns them.
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/lmdb_environment.h"

namespace repository {

/// Names a piece by a hash of everything that tells it from others.
using CacheKey = std::array<std::uint8_t, 16>;

struct RangeCacheOptions {
  /// The budget for pieces and their records. The file is at most a quarter and 64 MiB larger. Processes that share a
  /// cache should use the same budget.
  std::uint64_t bytes = std::uint64_t{4} << 30;
  /// Receives a line about each thing that the cache can no longer do, once; null: nothing is reported.
  std::function<void(const std::string&)> warn;
};

/// Safe from any thread.
class RangeCache {
 public:
  /// Uses a folder of its own below `directory` and creates both. Opening reads the first page of each piece. Errors:
  /// kIo, kUnsupported (a network file system), kNoSpace.
  static base::Result<std::unique_ptr<RangeCache>> open(const std::string& directory, const RangeCacheOptions& options);

  /// Returns a copy of the piece, or nothing. Counts as a use.
  std::optional<base::Bytes> get(const CacheKey& key);
  /// Never fails: after a full disk or a broken file the cache warns and stores nothing more.
  void put(const std::vector<std::pair<CacheKey, base::ByteView>>& pieces);
  /// The bytes that count against the budget.
  std::uint64_t usedBytes();

 private:
  RangeCache(std::string path, std::shared_ptr<LmdbEnvironment> environment, const RangeCacheOptions& options)
      : path_(std::move(path)), environment_(std::move(environment)), options_(options) {}
  static base::Result<std::unique_ptr<RangeCache>> openChecked(const std::string& path,
                                                               const RangeCacheOptions& options);

  template <class Body>
  int runTransaction(const Body& body);
  void noteUse(const CacheKey& key);
  void discardDamaged(const CacheKey& key);
  void evictTo(std::uint64_t bytes);
  void disableAfter(int code, std::uint64_t bytes);
  void warn(const std::string& message) const {
    if (options_.warn) options_.warn(path_ + ": " + message);
  }

  std::string path_;
  std::shared_ptr<LmdbEnvironment> environment_;
  RangeCacheOptions options_;
  std::atomic<bool> writes_{true};
  std::atomic<bool> reads_{true};
  std::atomic<bool> warned_of_damage_{false};
  std::mutex mutex_;
  std::set<CacheKey> used_;  // pieces used since the last transaction, which records them in the file
};

}  // namespace repository
