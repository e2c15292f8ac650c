#pragma once
// Reads remote objects through a cache on the local disk.
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <future>
#include <map>
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
#include "repository/objects/objects.h"

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

/// Keeps pieces of remote objects on the local disk, in an LMDB of bounded size that evicts the least recently used
/// piece first (docs/formats/cache.md). The cache survives restarts and kill -9, and several processes may share it. It
/// discards damaged pieces and never returns them. Safe from any thread.
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

/// Counts since the source was opened.
struct CacheCounts {
  std::uint64_t blocks_fetched = 0;  ///< from the source
  std::uint64_t blocks_shared = 0;   ///< fetched by another thread that wanted them at the same time
};

/// The cache keeps blocks of kBlockBytes, so that overlapping reads share them. A read fetches each run of missing
/// blocks by one range, and a block wanted by several threads is fetched once. Reads of more than kMaxCachedRead bytes
/// bypass the cache.
class CachedSource final : public ObjectSource {
 public:
  /// A block fills 16 pages of LMDB, whose first page begins with a header of 16 bytes.
  static constexpr std::uint64_t kBlockBytes = 16 * 4096 - 16;
  /// Half of a pack of the largest size; only whole-pack walks read more, once.
  static constexpr std::uint64_t kMaxCachedRead = std::uint64_t{64} << 20;

  /// Errors as RangeCache::open.
  static base::Result<std::unique_ptr<CachedSource>> open(std::shared_ptr<const ObjectSource> source,
                                                          const std::string& directory,
                                                          const RangeCacheOptions& options);

  base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override;
  base::Result<std::uint64_t> size(const std::string& name) const override;
  const std::string& place() const override { return source_->place(); }
  CacheCounts counts() const;
  RangeCache& cache() const { return *cache_; }

 private:
  using Block = std::shared_ptr<const base::Bytes>;
  using FetchResult = base::Result<Block>;
  using BlockKey = std::pair<std::string, std::uint64_t>;  // object and number of the block
  struct BlockRequest;

  CachedSource(std::shared_ptr<const ObjectSource> source, std::unique_ptr<RangeCache> cache)
      : source_(std::move(source)), cache_(std::move(cache)) {}
  CacheKey keyOf(const std::string& name, const std::string& entry) const;
  Block findBlock(const std::string& name, std::uint64_t block) const;
  void claimMissing(const std::string& name, std::vector<BlockRequest>& requests) const;
  void fetchClaimed(const std::string& name, std::uint64_t size, std::vector<BlockRequest>& requests) const;
  void fetchRun(const std::string& name, std::uint64_t size, BlockRequest* first, BlockRequest* end) const;
  void deliver(const std::string& name, BlockRequest& request, const FetchResult& result) const;

  std::shared_ptr<const ObjectSource> source_;
  std::unique_ptr<RangeCache> cache_;
  mutable std::mutex mutex_;
  mutable std::map<BlockKey, std::shared_future<FetchResult>> in_flight_;
  mutable std::map<std::string, std::uint64_t> sizes_;
  mutable std::atomic<std::uint64_t> fetched_{0}, shared_{0};
};

}  // namespace repository
