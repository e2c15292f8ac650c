#pragma once
// Reads remote objects through a cache on the local disk.
#include <atomic>
#include <cstdint>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "repository/objects/objects.h"
#include "repository/objects/range_cache.h"

namespace repository {

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
