#include "repository/objects/cached_source.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>

#include "base/crc32c.h"
#include "base/file.h"
#include "base/file_lock.h"
#include "base/hash/sha256.h"

namespace repository {
namespace {

namespace fs = std::filesystem;
using base::Bytes;
using base::Error;
using base::ErrorCode;
using base::Result;

const std::vector<const char*> kCacheTables{"meta", "index", "order", "data"};
constexpr std::size_t kCacheMeta = 0, kIndex = 1, kOrder = 2, kData = 3;  // indices into kCacheTables
// A folder of our own, since a damaged cache deletes its files.
constexpr const char* kFolder = "lumigrid-cache";
const std::string kTotalsKey = "state";
constexpr std::uint32_t kFormat = 1;
constexpr std::uint64_t kPage = 4096, kPageHeaderBytes = 16;  // LMDB's, on a 64-bit machine
constexpr std::uint64_t kRecordBytes = 160;  // a piece's nodes in the other tables, with room in their pages
constexpr std::size_t kMaxUsed = 4096;       // uses kept in memory before they are written; a choice
constexpr std::uint64_t kExtraMapBytes = std::uint64_t{64} << 20;

// LMDB needs room for the pages that a transaction replaces before it can free them.
std::uint64_t mapBytes(std::uint64_t budget) {
  return budget + budget / 4 + kExtraMapBytes;
}

// The bytes that a piece takes in the file.
std::uint64_t costOf(std::uint64_t bytes) {
  return (bytes + kPageHeaderBytes + kPage - 1) / kPage * kPage + kRecordBytes;
}

// The checksum covers the key too, so that the bytes of one piece are never returned for another.
std::uint32_t checksumOf(const CacheKey& key, base::ByteView bytes) {
  return base::crc32c(bytes, base::crc32c(key));
}

// A piece's record in table "index".
struct Record {
  std::uint64_t sequence = 0;  // number of its last use: its key, big-endian, in table "order"
  std::uint32_t bytes = 0;
  std::uint32_t checksum = 0;
};
static_assert(sizeof(Record) == 16);

// Reads a value that is one T; of another size it is MDB_CORRUPTED. Returns an LMDB code.
template <class T>
int getRecord(LmdbEnvironment& environment, MDB_txn* txn, std::size_t table, MDB_val name, T& record) {
  MDB_val value{};
  if (const int code = environment.get(txn, table, name, value); code != 0) return code;
  if (value.mv_size != sizeof(T)) return MDB_CORRUPTED;
  return environment.guarded([&] { return std::memcpy(&record, value.mv_data, sizeof(T)), 0; });
}

template <class T>
MDB_val viewOfRecord(const T& value) {
  return valueOf(base::ByteView(reinterpret_cast<const std::uint8_t*>(&value), sizeof(T)));
}

// Processes that have the files open go on with the removed ones until they end.
void removeFiles(const std::string& path) {
  std::error_code ignored;
  fs::remove(path + "/data.mdb", ignored);
  fs::remove(path + "/lock.mdb", ignored);
}

// The record of the whole cache, in table "meta".
struct Totals {
  std::uint32_t format = kFormat;
  std::uint32_t unused = 0;
  std::uint64_t bytes = 0;          // sum of costOf over all pieces
  std::uint64_t next_sequence = 1;  // number of the next use
};

// Changes the cache in one LMDB transaction. Every function returns an LMDB code; a damaged record is MDB_CORRUPTED.
class Transaction {
 public:
  Transaction(MDB_txn* txn, LmdbEnvironment* environment) : txn_(txn), environment_(environment) {}

  int readTotals() {
    const int code = getRecord(*environment_, txn_, kCacheMeta, valueOf(kTotalsKey), totals);
    return code == MDB_NOTFOUND ? 0 : code;
  }
  int writeTotals() { return putValue(kCacheMeta, kTotalsKey, viewOfRecord(totals)); }

  // Moves a used piece to the end of the order. A piece that is gone is no error.
  int recordUse(const CacheKey& key) {
    Record record;
    if (const int code = findRecord(key, record); code != 0) return code == MDB_NOTFOUND ? 0 : code;
    if (const int code = eraseValue(kOrder, bigEndian(record.sequence)); code != 0) return code;
    record.sequence = totals.next_sequence++;
    if (const int code = putValue(kOrder, bigEndian(record.sequence), valueOf(key)); code != 0) return code;
    return putValue(kIndex, key, viewOfRecord(record));
  }

  int putPiece(const CacheKey& key, base::ByteView bytes) {
    if (const int code = erasePiece(key); code != 0) return code;
    const Record record{totals.next_sequence++, static_cast<std::uint32_t>(bytes.size()), checksumOf(key, bytes)};
    if (const int code = putValue(kData, key, valueOf(bytes)); code != 0) return code;
    if (const int code = putValue(kIndex, key, viewOfRecord(record)); code != 0) return code;
    if (const int code = putValue(kOrder, bigEndian(record.sequence), valueOf(key)); code != 0) return code;
    totals.bytes += costOf(bytes.size());
    return 0;
  }

  // A piece that is not there is no error.
  int erasePiece(const CacheKey& key) {
    Record record;
    if (const int code = findRecord(key, record); code != 0) return code == MDB_NOTFOUND ? 0 : code;
    for (const int code :
         {eraseValue(kOrder, bigEndian(record.sequence)), eraseValue(kIndex, key), eraseValue(kData, key)})
      if (code != 0) return code;
    totals.bytes -= std::min(totals.bytes, costOf(record.bytes));
    return 0;
  }

  // Evicts the least recently used pieces until at most `max_bytes` are left.
  int evictTo(std::uint64_t max_bytes) {
    while (totals.bytes > max_bytes) {
      CacheKey key;
      NumberKey sequence;
      if (const int code = findOldest(sequence, key); code != 0) return code == MDB_NOTFOUND ? 0 : code;
      if (const int code = erasePiece(key); code != 0) return code;
      // An entry of the order without its piece would stay first forever.
      if (const int code = eraseValue(kOrder, sequence); code != 0) return code;
    }
    return 0;
  }

  Totals totals;

 private:
  int findRecord(const CacheKey& piece, Record& record) {
    return getRecord(*environment_, txn_, kIndex, valueOf(piece), record);
  }
  int findOldest(NumberKey& sequence, CacheKey& piece) {
    MDB_cursor* cursor = nullptr;
    return environment_->guarded([&] {
      if (const int code = mdb_cursor_open(txn_, environment_->table(kOrder), &cursor); code != 0) return code;
      MDB_val key{};
      MDB_val value{};
      int code = mdb_cursor_get(cursor, &key, &value, MDB_FIRST);
      if (code == 0 && (key.mv_size != sequence.size() || value.mv_size != piece.size())) code = MDB_CORRUPTED;
      if (code == 0) std::memcpy(sequence.data(), key.mv_data, sequence.size());
      if (code == 0) std::memcpy(piece.data(), value.mv_data, piece.size());
      mdb_cursor_close(cursor);
      return code;
    });
  }
  template <class Key>
  int putValue(std::size_t table, const Key& name, MDB_val value) {
    return environment_->put(txn_, table, valueOf(name), value);
  }
  template <class Key>
  int eraseValue(std::size_t table, const Key& name) {
    const int code = environment_->erase(txn_, table, valueOf(name));
    return code == MDB_NOTFOUND ? 0 : code;
  }

  MDB_txn* txn_;
  LmdbEnvironment* environment_;
};

}  // namespace

// ---- The cache ----

Result<std::unique_ptr<RangeCache>> RangeCache::open(const std::string& directory, const RangeCacheOptions& options) {
  std::error_code failed;
  const std::string folder = directory + "/" + kFolder;
  fs::create_directories(folder, failed);
  if (failed) return base::systemError(folder, "make this directory", failed.value());
  const std::string path = fs::canonical(folder, failed).string();
  if (failed) return base::systemError(folder, "open", failed.value());
  if (isOnNetwork(path))
    return base::Error{ErrorCode::kUnsupported,
                       directory + ": on a network file system, which the cache cannot use; give a local directory"};

  // Only one process at a time may open, check or remove the files.
  LUMIGRID_ASSIGN_OR_RETURN(const auto lock, base::lockFile(path + "/opening.lock"));
  const auto size = fs::file_size(path + "/data.mdb", failed);
  if (!failed && size > mapBytes(options.bytes)) removeFiles(path);  // an earlier budget was larger
  auto cache = openChecked(path, options);
  const auto is_damage = [](ErrorCode code) { return code == ErrorCode::kInvalidInput || code == ErrorCode::kVersion; };
  if (cache || !is_damage(cache.error().code)) return cache;
  if (options.warn) options.warn(path + ": the cache was damaged; it is begun anew");
  removeFiles(path);
  return openChecked(path, options);
}

Result<std::unique_ptr<RangeCache>> RangeCache::openChecked(const std::string& path, const RangeCacheOptions& options) {
  LmdbEnvironmentOptions environment_options;
  environment_options.map_bytes = mapBytes(options.bytes);
  environment_options.grows = false;
  // Commits need not wait for the disk, because damage by a power cut is noticed: the trees are checked when the file
  // is opened, and each piece when it is read.
  environment_options.durable = false;
  LUMIGRID_ASSIGN_OR_RETURN(auto environment, LmdbEnvironment::open(path, environment_options));
  if (environment->readOnly()) return base::systemError(path, "write to this directory", EACCES);
  LUMIGRID_TRY(environment->checkTrees(CheckDepth::kValues));
  if (const int code = environment->openTables(kCacheTables, true); code != 0)
    return storeError(path, "open", reasonOfFailedWrite(path, code, 0));

  std::unique_ptr<RangeCache> cache(new RangeCache(path, std::move(environment), options));
  bool known_format = false;
  const int code = cache->runTransaction([&](Transaction& transaction) {
    known_format = transaction.totals.format == kFormat;
    return known_format ? transaction.evictTo(options.bytes) : 0;
  });
  if (code != 0) return storeError(path, "open", reasonOfFailedWrite(path, code, 0));
  if (!known_format) return base::Error{ErrorCode::kVersion, path + ": a cache of another version"};
  return cache;
}

// Records the uses since the last transaction and runs body(transaction).
template <class Body>
int RangeCache::runTransaction(const Body& body) {
  std::set<CacheKey> used;
  {
    const std::lock_guard lock(mutex_);
    used.swap(used_);
  }
  return environment_->write([&](MDB_txn* txn) {
    Transaction transaction(txn, environment_.get());
    if (const int code = transaction.readTotals(); code != 0) return code;
    for (const CacheKey& key : used)
      if (const int code = transaction.recordUse(key); code != 0) return code;
    if (const int code = body(transaction); code != 0) return code;
    return transaction.writeTotals();
  });
}

std::optional<base::Bytes> RangeCache::get(const CacheKey& key) {
  if (!reads_) return std::nullopt;
  base::Bytes bytes;
  std::optional<Record> record;
  const int code = environment_->read([&](MDB_txn* txn) {
    Record read;
    const int indexed = getRecord(*environment_, txn, kIndex, valueOf(key), read);
    if (indexed != 0 && indexed != MDB_CORRUPTED) return indexed;
    if (indexed == 0) record = read;
    MDB_val value{};
    if (const int found = environment_->get(txn, kData, valueOf(key), value); found != 0) return found;
    return environment_->copy(value, bytes);
  });
  if (code != 0) {
    if (code != MDB_NOTFOUND) disableAfter(code, 0);
    return std::nullopt;
  }
  if (!record || record->bytes != bytes.size() || record->checksum != checksumOf(key, bytes)) {
    discardDamaged(key);
    return std::nullopt;
  }
  noteUse(key);
  return bytes;
}

void RangeCache::noteUse(const CacheKey& key) {
  {
    const std::lock_guard lock(mutex_);
    used_.insert(key);
    if (used_.size() < kMaxUsed) return;
  }
  if (!writes_) return;
  disableAfter(runTransaction([](Transaction&) { return 0; }), 0);
}

void RangeCache::discardDamaged(const CacheKey& key) {
  if (!warned_of_damage_.exchange(true))
    warn("a damaged piece was thrown away; look at this disk when it happens again");
  if (!writes_) return;
  disableAfter(runTransaction([&](Transaction& transaction) { return transaction.erasePiece(key); }), 0);
}

void RangeCache::put(const std::vector<std::pair<CacheKey, base::ByteView>>& pieces) {
  std::uint64_t bytes = 0;
  for (const auto& [key, piece] : pieces) bytes += costOf(piece.size());
  if (!writes_ || bytes > options_.bytes / 2) return;
  environment_->dropDeadReaders();
  const auto put_all = [&](Transaction& transaction) {
    for (const auto& [key, piece] : pieces)
      if (const int code = transaction.putPiece(key, piece); code != 0) return code;
    return transaction.evictTo(options_.bytes);
  };
  int code = runTransaction(put_all);
  // The map may be full although the budget is not: LMDB reuses the pages of evicted pieces only after a commit, and
  // only when no reader can see them any more. So we evict an eighth first; if that does not help, these pieces are
  // not cached.
  if (code == MDB_MAP_FULL) {
    evictTo(options_.bytes / 8 * 7);
    code = runTransaction(put_all);
  }
  disableAfter(code, bytes);
}

void RangeCache::evictTo(std::uint64_t bytes) {
  disableAfter(runTransaction([&](Transaction& transaction) { return transaction.evictTo(bytes); }), 0);
}

// After a full disk the cache only reads; after any other failure of LMDB but a full map it does nothing at all.
void RangeCache::disableAfter(int code, std::uint64_t bytes) {
  if (code == 0 || code == MDB_MAP_FULL) return;
  const int reason = reasonOfFailedWrite(path_, code, bytes);
  const bool no_space = reason == ENOSPC || reason == EDQUOT || reason == EFBIG;
  if (!no_space) reads_ = false;
  if (!writes_.exchange(false)) return;
  const std::string why = reason > 0             ? std::strerror(reason)
                          : reason == kReadFault ? "a read failed: its file was cut or the disk fails"
                                                 : mdb_strerror(reason);
  warn(no_space ? "nothing more is cached (" + why + "); free some space and start again"
                : "the cache is not used any more (" + why + "); start again, it is then checked");
}

std::uint64_t RangeCache::usedBytes() {
  std::uint64_t bytes = 0;
  const int code = environment_->read([&](MDB_txn* txn) {
    Transaction transaction(txn, environment_.get());
    const int result = transaction.readTotals();
    bytes = transaction.totals.bytes;
    return result;
  });
  return code == 0 ? bytes : 0;
}

// ---- The source ----

// A block that a read needs. It is found in the cache, fetched by this thread, or fetched by another one.
struct CachedSource::BlockRequest {
  std::uint64_t number = 0;
  Block block;                                       // null until it is found or fetched
  std::optional<std::promise<FetchResult>> promise;  // set while this thread fetches it: others wait for it
  std::shared_future<FetchResult> result;
};

Result<std::unique_ptr<CachedSource>> CachedSource::open(std::shared_ptr<const ObjectSource> source,
                                                         const std::string& directory,
                                                         const RangeCacheOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto cache, RangeCache::open(directory, options));
  return std::unique_ptr<CachedSource>(new CachedSource(std::move(source), std::move(cache)));
}

CacheKey CachedSource::keyOf(const std::string& name, const std::string& entry) const {
  const base::Sha256Digest digest = base::sha256(base::viewOfText(source_->place() + "\n\n" + name + "\n" + entry));
  CacheKey key;
  std::copy_n(digest.begin(), key.size(), key.begin());
  return key;
}

CachedSource::Block CachedSource::findBlock(const std::string& name, std::uint64_t block) const {
  auto bytes = cache_->get(keyOf(name, std::to_string(block)));
  if (!bytes) return nullptr;
  return std::make_shared<const Bytes>(std::move(*bytes));
}

Result<std::uint64_t> CachedSource::size(const std::string& name) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto it = sizes_.find(name); it != sizes_.end()) return it->second;
  }
  const CacheKey key = keyOf(name, "size");
  std::uint64_t bytes = 0;
  if (const auto cached = cache_->get(key); cached && cached->size() == sizeof(bytes)) {
    std::memcpy(&bytes, cached->data(), sizeof(bytes));
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(bytes, source_->size(name));
    cache_->put({{key, {reinterpret_cast<const std::uint8_t*>(&bytes), sizeof(bytes)}}});
  }
  const std::lock_guard lock(mutex_);
  return sizes_.emplace(name, bytes).first->second;
}

Result<Bytes> CachedSource::read(const std::string& name, std::uint64_t offset, std::uint64_t length) const {
  if (length > kMaxCachedRead) return source_->read(name, offset, length);
  LUMIGRID_ASSIGN_OR_RETURN(const auto whole, size(name));
  if (offset > whole || length > whole - offset) return tooShortError(place() + "/" + name, whole, offset, length);
  if (length == 0) return Bytes();

  // The blocks of the range, and those of them that are in the cache.
  const std::uint64_t first = offset / kBlockBytes;
  std::vector<BlockRequest> requests((offset + length - 1) / kBlockBytes - first + 1);
  for (std::size_t i = 0; i < requests.size(); ++i) {
    requests[i].number = first + i;
    requests[i].block = findBlock(name, first + i);
  }

  // A thread fetches the blocks it has claimed before it waits for those of others, so no two threads wait for each
  // other.
  claimMissing(name, requests);
  fetchClaimed(name, whole, requests);
  for (BlockRequest& request : requests) {
    if (request.block != nullptr) continue;
    const FetchResult& result = request.result.get();
    if (!result) return result.error();
    request.block = *result;
  }

  Bytes bytes;
  bytes.reserve(length);
  for (const BlockRequest& request : requests) {
    const std::uint64_t start = request.number * kBlockBytes;
    const std::uint64_t begin = std::max(offset, start) - start;
    const std::uint64_t end = std::min(offset + length - start, kBlockBytes);
    // A block too short was cached when a shorter object had this name.
    if (request.block->size() < end) return source_->read(name, offset, length);
    bytes.insert(bytes.end(), request.block->begin() + static_cast<std::ptrdiff_t>(begin),
                 request.block->begin() + static_cast<std::ptrdiff_t>(end));
  }
  return bytes;
}

// Claims each missing block, unless another thread is fetching it already.
void CachedSource::claimMissing(const std::string& name, std::vector<BlockRequest>& requests) const {
  const std::lock_guard lock(mutex_);
  for (BlockRequest& request : requests) {
    if (request.block != nullptr) continue;
    auto& result = in_flight_[{name, request.number}];
    if (result.valid()) {
      ++shared_;
    } else {
      request.promise.emplace();
      result = request.promise->get_future().share();
    }
    request.result = result;
  }
}

void CachedSource::fetchClaimed(const std::string& name, std::uint64_t size,
                                std::vector<BlockRequest>& requests) const {
  // Another thread may have cached a block between our look-up and our claim.
  for (BlockRequest& request : requests)
    if (request.promise)
      if (const Block block = findBlock(name, request.number); block != nullptr) deliver(name, request, block);

  const auto is_claimed = [](const BlockRequest& request) { return request.promise.has_value(); };
  BlockRequest* const end = requests.data() + requests.size();
  for (BlockRequest* run = requests.data(); (run = std::find_if(run, end, is_claimed)) != end;) {
    BlockRequest* const run_end = std::find_if_not(run, end, is_claimed);
    fetchRun(name, size, run, run_end);
    run = run_end;
  }
}

// Fetches neighbouring blocks by one read.
void CachedSource::fetchRun(const std::string& name, std::uint64_t size, BlockRequest* first, BlockRequest* end) const {
  const std::uint64_t offset = first->number * kBlockBytes;
  const std::uint64_t length = std::min(size - offset, static_cast<std::uint64_t>(end - first) * kBlockBytes);
  const auto bytes = source_->read(name, offset, length);
  if (!bytes) {
    for (BlockRequest* request = first; request != end; ++request) deliver(name, *request, bytes.error());
    return;
  }
  std::vector<std::pair<CacheKey, base::ByteView>> blocks;
  for (BlockRequest* request = first; request != end; ++request) {
    const std::uint64_t at = (request->number - first->number) * kBlockBytes;
    blocks.emplace_back(keyOf(name, std::to_string(request->number)),
                        base::ByteView(*bytes).subspan(at, std::min(kBlockBytes, length - at)));
  }
  // The blocks are cached before they are delivered, so that a thread that asks in between finds them.
  cache_->put(blocks);
  fetched_ += blocks.size();
  for (std::size_t i = 0; i < blocks.size(); ++i)
    deliver(name, first[i], std::make_shared<const Bytes>(blocks[i].second.begin(), blocks[i].second.end()));
}

void CachedSource::deliver(const std::string& name, BlockRequest& request, const FetchResult& result) const {
  if (result) request.block = *result;
  request.promise->set_value(result);
  request.promise.reset();
  const std::lock_guard lock(mutex_);
  in_flight_.erase({name, request.number});
}

CacheCounts CachedSource::counts() const {
  return {fetched_.load(), shared_.load()};
}

}  // namespace repository
