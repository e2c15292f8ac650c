#pragma once
// A published repository, read by range from wherever it lies (docs/formats/packs.md).
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
  std::uint64_t block_cache_bytes = std::uint64_t{16} << 20;  ///< of decoded index blocks, about 20 KB each
  /// getMany: values of a pack that lie no farther apart than this are read as one range …
  std::uint64_t gap_bytes = std::uint64_t{64} << 10;
  /// … of at most so many bytes.
  std::uint64_t range_bytes = std::uint64_t{8} << 20;
  /// getMany, check: reads under way at a time, 1 or more. More pay where each takes a round trip.
  unsigned jobs = 1;
};

/// Read-only: putBatch, erase and writeMeta are kUnsupported. Safe from several threads. What is damaged or missing
/// is an error that names the object, for the faces that it holds; all others go on being served, and the next get
/// tries again.
class PackStore final : public Store {
 public:
  /// Reads the index's root and parameters. `index` is its object's name, as scene.json says.
  /// Errors: those of ObjectSource::read; kInvalidInput for damaged bytes; kVersion.
  static base::Result<std::unique_ptr<PackStore>> open(std::shared_ptr<const ObjectSource> source,
                                                       const std::string& index, const PackStoreOptions& options = {});

  /// At most two range reads: a block of the index, if it is not cached, and the value, unless it is an empty flag.
  base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const override;
  /// One Result per key, in their order. Values that lie near each other in a pack come by one range read; each block
  /// of the index is read once.
  using Values = std::vector<base::Result<std::optional<base::Bytes>>>;
  Values getMany(const std::vector<FaceKey>& keys) const override;
  base::Result<bool> contains(const FaceKey& key) const override;
  /// Pack by pack; the first that is damaged ends it.
  base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const override;
  base::Result<std::uint64_t> size() const override { return root_.keys; }
  base::Result<std::optional<std::string>> readMeta() const override { return std::optional(parameters_); }
  base::Result<void> putBatch(const std::vector<std::pair<FaceKey, base::Bytes>>& batch) override;
  base::Result<void> erase(const std::vector<FaceKey>& keys) override;
  base::Result<void> writeMeta(const std::string& text) override;

  /// Is told what get and getMany could not read, from their threads; set it before they run.
  void setErrorListener(std::function<void(const base::Error&)> listener) { error_listener_ = std::move(listener); }
  /// The counts of its root; costs nothing.
  const IndexRoot& root() const { return root_; }
  /// The names of all packs, in order of their keys.
  base::Result<std::vector<PackRow>> packs() const;

  /// Reads everything: the index's hash and every block; every pack's hash and table; whether both say the same.
  /// `fault` gets a line for each fault and returns false when that is enough; `visit` every value that can be read, in
  /// order of keys, as it is, until it returns false; both on this thread. `jobs` packs are read at a time, as many as
  /// fit in 128 MB (one always does). A place that cannot be reached any more (kNetwork) ends it, with a fault that
  /// says so.
  using Visit = std::function<bool(const FaceKey&, base::ByteView)>;
  void check(const std::function<bool(std::string)>& fault, const Visit& visit) const;

 private:
  using Block = std::shared_ptr<const IndexBlock>;
  using Fault = std::function<void(std::string)>;
  struct Wanted;
  struct Range;
  PackStore(std::shared_ptr<const ObjectSource> source, std::string index, const PackStoreOptions& options)
      : source_(std::move(source)), index_(std::move(index)), options_(options), blocks_(options.block_cache_bytes) {}

  base::Result<std::optional<base::Bytes>> read(const FaceKey& key) const;
  base::Error inIndex(const base::Error& error) const;
  base::Result<Block> block(std::uint64_t number) const;
  base::Result<std::optional<FacePlace>> find(const FaceKey& key) const;
  std::vector<Range> rangesOf(std::span<const Wanted> wanted) const;
  void loadBlocks(const std::vector<FaceKey>& keys) const;
  void readRange(const Range& range, Values& out) const;
  base::Result<PackTable> tableOf(const PackRow& row, base::ByteView pack) const;
  base::Result<bool> visitPack(const PackTable& table, base::ByteView pack, const Visit& visit) const;
  /// A whole pack from its place, its SHA-256 compared with its name.
  struct FarPack {
    base::Result<base::Bytes> bytes;
    bool is_of_its_name = false;
    base::Result<std::uint64_t> size;
  };
  PrefetchLimits prefetchLimits() const;
  void checkIndex(const Fault& fault) const;
  void checkTotals(std::uint64_t value_bytes, const Fault& fault) const;
  FarPack fetchPack(const PackRow& row) const;
  bool checkPack(const PackRow& row, const FarPack& pack, const Fault& fault, const Visit& visit) const;
  void comparePlaces(const PackRow& row, const PackTable& table, const Fault& fault) const;

  std::shared_ptr<const ObjectSource> source_;
  std::string index_;
  PackStoreOptions options_;
  IndexRoot root_;
  std::string parameters_;
  std::function<void(const base::Error&)> error_listener_;
  mutable std::mutex mutex_;  // of blocks_
  mutable LruCache<std::uint64_t, Block> blocks_;
};

}  // namespace repository
