#pragma once
// Objects that are far away, read through a cache on the local disk.
#include <atomic>
#include <cstdint>
#include <functional>
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

struct CachedSourceOptions {
  RangeCacheOptions cache;
  /// What tells publications at the same place apart, if their objects have the same names: a hash of the index. What
  /// was kept of another version is not found, and goes in time.
  std::string version;
  /// Objects that may change under their name: always asked for at the source. Null: none.
  std::function<bool(const std::string& name)> is_mutable;
};

/// What was read since it was opened, for tests and /metrics.
struct CacheCounts {
  std::uint64_t blocks_found = 0;    ///< in the cache
  std::uint64_t blocks_fetched = 0;  ///< from the source
  std::uint64_t fetches = 0;         ///< reads at the source
  std::uint64_t blocks_shared = 0;   ///< fetched by another thread that wanted them at the same time
};

/// Blocks of kBlockBytes are kept, so that reads that overlap share them; a read fetches what it lacks in one range per
/// gap. The same block wanted by several threads is fetched once. Reads of more than kMaxCachedRead go past the cache.
class CachedSource final : public ObjectSource {
 public:
  /// 16 pages of LMDB: a page header of 16 bytes, then the value.
  static constexpr std::uint64_t kBlockBytes = 16 * 4096 - 16;
  static constexpr std::uint64_t kMaxCachedRead = std::uint64_t{64} << 20;

  /// Errors as RangeCache::open.
  static base::Result<std::unique_ptr<CachedSource>> open(std::shared_ptr<const ObjectSource> source,
                                                          const std::string& directory,
                                                          const CachedSourceOptions& options);

  base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override;
  base::Result<std::uint64_t> size(const std::string& name) const override;
  const std::string& place() const override { return source_->place(); }
  CacheCounts counts() const;
  RangeCache& cache() const { return *cache_; }

 private:
  using Block = std::shared_ptr<const base::Bytes>;
  using Fetched = base::Result<Block>;
  using BlockKey = std::pair<std::string, std::uint64_t>;  // object and number of the block
  struct Wanted;

  CachedSource(std::shared_ptr<const ObjectSource> source, std::unique_ptr<RangeCache> cache,
               const CachedSourceOptions& options)
      : source_(std::move(source)), cache_(std::move(cache)), options_(options) {}
  bool isMutable(const std::string& name) const { return options_.is_mutable && options_.is_mutable(name); }
  PieceId idOf(const std::string& name, const std::string& piece) const;
  Block find(const std::string& name, std::uint64_t block) const;
  void claim(const std::string& name, std::vector<Wanted>& wanted) const;
  void fetchClaimed(const std::string& name, std::uint64_t size, std::vector<Wanted>& wanted) const;
  void fetchRun(const std::string& name, std::uint64_t size, Wanted* first, Wanted* end) const;
  void deliver(const std::string& name, Wanted& wanted, const Fetched& fetched) const;

  std::shared_ptr<const ObjectSource> source_;
  std::unique_ptr<RangeCache> cache_;
  CachedSourceOptions options_;
  mutable std::mutex mutex_;
  mutable std::map<BlockKey, std::shared_future<Fetched>> in_flight_;
  mutable std::map<std::string, std::uint64_t> sizes_;
  mutable std::atomic<std::uint64_t> found_{0}, fetched_{0}, fetches_{0}, shared_{0};
};

}  // namespace repository
