#pragma once
// Pieces of far objects on the local disk: an LMDB of bounded size from which the least recently used goes first
// (docs/formats/cache.md). It survives restarts and kill -9; several processes may share it; what is damaged is thrown
// away, never trusted.
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

/// Which piece: a hash of everything that tells it from others.
using PieceId = std::array<std::uint8_t, 16>;

struct RangeCacheOptions {
  /// Of pieces and what keeping them costs. The file is at most a quarter and 64 MiB larger. Processes that share a
  /// cache should agree on it.
  std::uint64_t bytes = std::uint64_t{4} << 30;
  /// Told in one line what the cache can do no more, once for each thing; null: nobody.
  std::function<void(const std::string&)> warn;
};

/// From any thread.
class RangeCache {
 public:
  /// In a folder of its own below `directory`, which is made. Opening reads the first page of each piece. Errors: kIo,
  /// kUnsupported (a network file system), kNoSpace.
  static base::Result<std::unique_ptr<RangeCache>> open(const std::string& directory, const RangeCacheOptions& options);

  /// A copy, or nothing. Counts as a use.
  std::optional<base::Bytes> get(const PieceId& id);
  /// Never fails: a full disk or a broken file only ends the keeping, and is warned of.
  void put(const std::vector<std::pair<PieceId, base::ByteView>>& pieces);
  /// Bytes that count against the budget.
  std::uint64_t usedBytes();

 private:
  struct State;
  RangeCache(std::string path, SharedLmdb environment, const RangeCacheOptions& options)
      : path_(std::move(path)), environment_(std::move(environment)), options_(options) {}
  static base::Result<std::unique_ptr<RangeCache>> openSound(const std::string& path, const RangeCacheOptions& options);

  template <class Body>
  int change(const Body& body);
  void touch(const PieceId& id);
  void forget(const PieceId& id);
  void evictTo(std::uint64_t bytes);
  void failed(int code, std::uint64_t bytes);
  void warn(const std::string& what) const {
    if (options_.warn) options_.warn(path_ + ": " + what);
  }

  std::string path_;
  SharedLmdb environment_;
  RangeCacheOptions options_;
  std::atomic<bool> writes_{true};
  std::atomic<bool> reads_{true};
  std::atomic<bool> warned_of_damage_{false};
  std::mutex mutex_;
  std::set<PieceId> used_;  // since the last write, which tells the file
};

}  // namespace repository
