#pragma once
// Reads a published repository by ranges of its objects, wherever they lie (docs/formats/packs.md).
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "repository/cache.h"
#include "repository/objects/objects.h"
#include "repository/packs/pack_format.h"
#include "repository/packs/prefetch.h"
#include "repository/store.h"

namespace repository {

struct PackStoreOptions {
  std::uint64_t block_cache_bytes = std::uint64_t{16} << 20;  ///< for decoded index blocks, about 20 KB each
  /// getMany reads values of a pack that lie no farther apart than this as one range.
  std::uint64_t gap_bytes = std::uint64_t{64} << 10;
  /// A range covers at most this many bytes.
  std::uint64_t range_bytes = std::uint64_t{8} << 20;
  /// The number of reads that getMany and check run at a time, 1 or more. More of them pay where each read takes a
  /// round trip.
  unsigned jobs = 1;
};

/// The store is read-only: putBatch, erase and writeMeta return kUnsupported. It is safe from several threads. A
/// damaged or missing object gives an error that names it, for the faces that it holds; all other faces are still
/// served, and the next get tries again.
class PackStore final : public Store {
 public:
  /// Reads the root and the parameters of the index, whose object name stands in scene.json.
  /// Errors: those of ObjectSource::read; kInvalidInput for damaged bytes; kVersion.
  static base::Result<std::unique_ptr<PackStore>> open(std::shared_ptr<const ObjectSource> source,
                                                       const std::string& index, const PackStoreOptions& options = {});

  /// Takes at most two range reads: a block of the index, if it is not cached, and the value, unless it is an empty
  /// flag.
  base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const override;
  /// Returns one Result per key, in their order. Values that lie near each other in a pack come by one range read, and
  /// each block of the index is read once.
  using Values = std::vector<base::Result<std::optional<base::Bytes>>>;
  Values getMany(const std::vector<FaceKey>& keys) const override;
  base::Result<std::optional<std::uint64_t>> valueBytes(const FaceKey& key) const override;
  /// Reads pack by pack and ends at the first damaged one.
  base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const override;
  base::Result<std::uint64_t> size() const override { return root_.keys; }
  base::Result<std::optional<std::string>> readMeta() const override { return std::optional(parameters_); }

  /// The listener receives the errors of get and getMany, on their threads. Set it before they run.
  void setErrorListener(std::function<void(const base::Error&)> listener) { error_listener_ = std::move(listener); }
  /// The root of the index with its counts; no read is needed.
  const IndexRoot& root() const { return root_; }
  /// Reads the rows of all packs, in order of their keys.
  base::Result<std::vector<PackRow>> readPackRows() const;

  /// Reads everything and checks the hash and every block of the index, the hash and table of every pack, and that both
  /// agree. `fault` receives a line for each fault and returns false when there are enough; `visit` receives every
  /// readable value, in order of keys and unchecked, until it returns false. Both are called on this thread. `jobs`
  /// packs are read at a time, as many as fit into 128 MB (one always does). When the place can no longer be reached
  /// (kNetwork), the check ends with a fault that says so.
  using Visit = std::function<bool(const FaceKey&, base::ByteView)>;
  void check(const std::function<bool(std::string)>& fault, const Visit& visit) const;

 private:
  using Block = std::shared_ptr<const IndexBlock>;
  using ReportFault = std::function<void(std::string)>;
  struct ValueRequest;
  struct ValueRange;
  PackStore(std::shared_ptr<const ObjectSource> source, std::string index, const PackStoreOptions& options)
      : source_(std::move(source)), index_(std::move(index)), options_(options), blocks_(options.block_cache_bytes) {}

  base::Error readOnlyError() const override;
  base::Result<std::optional<base::Bytes>> readValue(const FaceKey& key) const;
  base::Error indexError(const base::Error& error) const;
  base::Result<Block> loadBlock(std::uint64_t number) const;
  base::Result<std::optional<FaceLocation>> locate(const FaceKey& key) const;
  std::vector<ValueRange> rangesOf(std::span<const ValueRequest> requests) const;
  void loadBlocks(const std::vector<FaceKey>& keys) const;
  void readRange(const ValueRange& range, Values& out) const;
  base::Result<PackTable> tableOf(const PackRow& row, base::ByteView pack) const;
  base::Result<bool> visitPack(const PackTable& table, base::ByteView pack, const Visit& visit) const;
  /// A whole pack as it was read for a check.
  struct PackContent {
    base::Result<base::Bytes> bytes;
    bool matches_name = false;  ///< its SHA-256 is the one in its name
    base::Result<std::uint64_t> size;
  };
  PrefetchLimits prefetchLimits() const;
  void checkIndex(const ReportFault& fault) const;
  void checkTotals(std::uint64_t value_bytes, const ReportFault& fault) const;
  PackContent fetchPack(const PackRow& row) const;
  bool checkPack(const PackRow& row, const PackContent& pack, const ReportFault& fault, const Visit& visit) const;
  void compareLocations(const PackRow& row, const PackTable& table, const ReportFault& fault) const;

  std::shared_ptr<const ObjectSource> source_;
  std::string index_;
  PackStoreOptions options_;
  IndexRoot root_;
  std::string parameters_;
  std::function<void(const base::Error&)> error_listener_;
  mutable std::mutex mutex_;  // guards blocks_
  mutable LruCache<std::uint64_t, Block> blocks_;
};

}  // namespace repository
