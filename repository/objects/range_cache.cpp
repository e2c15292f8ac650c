#include "repository/objects/range_cache.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "base/crc32c.h"
#include "base/file.h"
#include "base/file_lock.h"

namespace repository {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;
using base::Result;

const std::vector<const char*> kTables{"meta", "index", "order", "data"};
constexpr std::size_t kMeta = 0, kIndex = 1, kOrder = 2, kData = 3;  // places in kTables
constexpr const char* kFolder = "lumigrid-cache";  // what is in it may be deleted, so it is ours alone
const std::string kStateKey = "state";
constexpr std::uint32_t kFormat = 1;
constexpr std::uint64_t kPage = 4096, kPageHeader = 16;
constexpr std::uint64_t kNodes = 160;   // of a piece, in the other tables
constexpr std::size_t kMaxUsed = 4096;  // uses that are remembered before the file is told
constexpr std::uint64_t kRoomBesides = std::uint64_t{64} << 20;

std::uint64_t mapBytes(std::uint64_t budget) {
  return budget + budget / 4 + kRoomBesides;
}

// What a piece takes of the file.
std::uint64_t costOf(std::uint64_t bytes) {
  return (bytes + kPageHeader + kPage - 1) / kPage * kPage + kNodes;
}

// The piece's own id is in its checksum, so that another piece's bytes are not taken for it.
std::uint32_t checksumOf(const PieceId& id, base::ByteView bytes) {
  return base::crc32c(bytes, base::crc32c(id));
}

// A piece's record in table "index".
struct Record {
  std::uint64_t sequence = 0;  // of its last use: its key, big-endian, in table "order"
  std::uint32_t bytes = 0;
  std::uint32_t checksum = 0;
};
static_assert(sizeof(Record) == 16);

template <class T>
std::optional<T> copyOf(const MDB_val& value) {
  if (value.mv_size != sizeof(T)) return std::nullopt;
  T copy;
  std::memcpy(&copy, value.mv_data, sizeof(T));
  return copy;
}

template <class T>
MDB_val bytesOf(const T& value) {
  return valueOf(base::ByteView(reinterpret_cast<const std::uint8_t*>(&value), sizeof(T)));
}

// Processes that have the files open keep theirs until they end.
void removeFiles(const std::string& path) {
  std::error_code ignored;
  fs::remove(path + "/data.mdb", ignored);
  fs::remove(path + "/lock.mdb", ignored);
}

}  // namespace

// The record of the whole, in table "meta".
struct RangeCache::State {
  std::uint32_t format = kFormat;
  std::uint32_t unused = 0;
  std::uint64_t bytes = 0;          // of all pieces, by costOf
  std::uint64_t next_sequence = 1;  // for the next use
};

namespace {

// What a write changes, in one transaction. Each returns an LMDB code; a damaged record is MDB_CORRUPTED.
template <class State>
class Transaction {
 public:
  Transaction(MDB_txn* txn, LmdbEnvironment* environment) : txn_(txn), environment_(environment) {}

  int begin() {
    MDB_val key = valueOf(kStateKey);
    MDB_val value{};
    const int code = mdb_get(txn_, environment_->table(kMeta), &key, &value);
    if (code == MDB_NOTFOUND) return 0;
    if (code != 0) return code;
    const auto read = copyOf<State>(value);
    if (!read) return MDB_CORRUPTED;
    state = *read;
    return 0;
  }
  int end() { return put(kMeta, kStateKey, bytesOf(state)); }

  // A use: the piece moves to the end of the order. One that is gone is no error.
  int use(const PieceId& id) {
    Record record;
    if (const int code = find(id, record); code != 0) return code == MDB_NOTFOUND ? 0 : code;
    if (const int code = drop(kOrder, bigEndian(record.sequence)); code != 0) return code;
    record.sequence = state.next_sequence++;
    if (const int code = put(kOrder, bigEndian(record.sequence), valueOf(id)); code != 0) return code;
    return put(kIndex, id, bytesOf(record));
  }

  int keep(const PieceId& id, base::ByteView bytes) {
    if (const int code = remove(id); code != 0) return code;
    const Record record{state.next_sequence++, static_cast<std::uint32_t>(bytes.size()), checksumOf(id, bytes)};
    if (const int code = put(kData, id, valueOf(bytes)); code != 0) return code;
    if (const int code = put(kIndex, id, bytesOf(record)); code != 0) return code;
    if (const int code = put(kOrder, bigEndian(record.sequence), valueOf(id)); code != 0) return code;
    state.bytes += costOf(bytes.size());
    return 0;
  }

  // One that is not there is no error.
  int remove(const PieceId& id) {
    Record record;
    if (const int code = find(id, record); code != 0) return code == MDB_NOTFOUND ? 0 : code;
    for (const int code : {drop(kOrder, bigEndian(record.sequence)), drop(kIndex, id), drop(kData, id)})
      if (code != 0) return code;
    state.bytes -= std::min(state.bytes, costOf(record.bytes));
    return 0;
  }

  // The least recently used go until at most `most` bytes are left.
  int evictTo(std::uint64_t most) {
    while (state.bytes > most) {
      PieceId id;
      NumberKey key;
      if (const int code = oldest(key, id); code != 0) return code == MDB_NOTFOUND ? 0 : code;
      if (const int code = remove(id); code != 0) return code;
      if (const int code = drop(kOrder, key); code != 0) return code;  // an order without a piece would stay first
    }
    return 0;
  }

  State state;

 private:
  int find(const PieceId& id, Record& record) {
    MDB_val key = valueOf(id);
    MDB_val value{};
    if (const int code = mdb_get(txn_, environment_->table(kIndex), &key, &value); code != 0) return code;
    const auto read = copyOf<Record>(value);
    if (!read) return MDB_CORRUPTED;
    record = *read;
    return 0;
  }
  int oldest(NumberKey& sequence, PieceId& id) {
    MDB_cursor* raw = nullptr;
    if (const int code = mdb_cursor_open(txn_, environment_->table(kOrder), &raw); code != 0) return code;
    const std::unique_ptr<MDB_cursor, decltype(&mdb_cursor_close)> cursor(raw, mdb_cursor_close);
    MDB_val key{};
    MDB_val value{};
    if (const int code = mdb_cursor_get(raw, &key, &value, MDB_FIRST); code != 0) return code;
    const auto read_key = copyOf<NumberKey>(key);
    const auto read_id = copyOf<PieceId>(value);
    if (!read_key || !read_id) return MDB_CORRUPTED;
    sequence = *read_key;
    id = *read_id;
    return 0;
  }
  template <class Key>
  int put(std::size_t table, const Key& name, MDB_val value) {
    MDB_val key = valueOf(name);
    return mdb_put(txn_, environment_->table(table), &key, &value, 0);
  }
  template <class Key>
  int drop(std::size_t table, const Key& name) {
    MDB_val key = valueOf(name);
    const int code = mdb_del(txn_, environment_->table(table), &key, nullptr);
    return code == MDB_NOTFOUND ? 0 : code;
  }

  MDB_txn* txn_;
  LmdbEnvironment* environment_;
};

}  // namespace

Result<std::unique_ptr<RangeCache>> RangeCache::open(const std::string& directory, const RangeCacheOptions& options) {
  std::error_code failed;
  const std::string folder = directory + "/" + kFolder;
  fs::create_directories(folder, failed);
  if (failed) return base::systemError(folder, "make this directory", failed.value());
  const std::string path = fs::canonical(folder, failed).string();
  if (failed) return base::systemError(folder, "open", failed.value());
  if (isOnNetwork(path))
    return Error{ErrorCode::kUnsupported,
                 directory + ": on a network file system, which the cache cannot use; give a local directory"};

  // So that no two processes open, check or throw the files away at once.
  LUMIGRID_ASSIGN_OR_RETURN(const auto lock, base::lockFile(path + "/opening.lock"));
  const auto size = fs::file_size(path + "/data.mdb", failed);
  if (!failed && size > mapBytes(options.bytes)) removeFiles(path);  // from a time of a larger budget
  auto cache = openSound(path, options);
  const auto is_damage = [](ErrorCode code) { return code == ErrorCode::kInvalidInput || code == ErrorCode::kVersion; };
  if (cache || !is_damage(cache.error().code)) return cache;
  if (options.warn) options.warn(path + ": the cache was damaged; it is begun anew");
  removeFiles(path);
  return openSound(path, options);
}

Result<std::unique_ptr<RangeCache>> RangeCache::openSound(const std::string& path, const RangeCacheOptions& options) {
  LmdbEnvironmentOptions environment_options;
  environment_options.map_bytes = mapBytes(options.bytes);
  environment_options.grows = false;
  // Each piece is checked when it is read, and the trees when the file is opened: what a power cut leaves is either
  // sound or thrown away, and no read waits for the disk.
  environment_options.durable = false;
  LUMIGRID_ASSIGN_OR_RETURN(auto environment, SharedLmdb::open(path, environment_options));
  if (environment->readOnly()) return base::systemError(path, "write to this directory", EACCES);
  LUMIGRID_TRY(environment->checkTrees(CheckDepth::kValues));
  if (const int code = environment->openTables(kTables, true); code != 0)
    return storeError(path, "open", reasonOfFailedWrite(path, code, 0));

  std::unique_ptr<RangeCache> cache(new RangeCache(path, std::move(environment), options));
  bool known_format = false;
  const int code = cache->change([&](Transaction<State>& transaction) {
    known_format = transaction.state.format == kFormat;
    return known_format ? transaction.evictTo(options.bytes) : 0;
  });
  if (code != 0) return storeError(path, "open", reasonOfFailedWrite(path, code, 0));
  if (!known_format) return Error{ErrorCode::kVersion, path + ": a cache of another version"};
  return cache;
}

// Runs body(transaction) and tells the file about the uses since the last time.
template <class Body>
int RangeCache::change(const Body& body) {
  std::set<PieceId> used;
  {
    const std::lock_guard lock(mutex_);
    used.swap(used_);
  }
  return environment_->write([&](MDB_txn* txn) {
    Transaction<State> transaction(txn, environment_.operator->());
    if (const int code = transaction.begin(); code != 0) return code;
    for (const PieceId& id : used)
      if (const int code = transaction.use(id); code != 0) return code;
    if (const int code = body(transaction); code != 0) return code;
    return transaction.end();
  });
}

std::optional<base::Bytes> RangeCache::get(const PieceId& id) {
  if (!reads_) return std::nullopt;
  base::Bytes bytes;
  std::optional<Record> record;
  const int code = environment_->read([&](MDB_txn* txn) {
    MDB_val key = valueOf(id);
    MDB_val value{};
    if (const int found = mdb_get(txn, environment_->table(kIndex), &key, &value); found != 0) return found;
    record = copyOf<Record>(value);
    if (const int found = mdb_get(txn, environment_->table(kData), &key, &value); found != 0) return found;
    bytes.assign(viewOf(value).begin(), viewOf(value).end());
    return 0;
  });
  if (code != 0) {
    if (code != MDB_NOTFOUND) failed(code, 0);
    return std::nullopt;
  }
  if (!record || record->bytes != bytes.size() || record->checksum != checksumOf(id, bytes)) {
    forget(id);
    return std::nullopt;
  }
  touch(id);
  return bytes;
}

void RangeCache::touch(const PieceId& id) {
  {
    const std::lock_guard lock(mutex_);
    used_.insert(id);
    if (used_.size() < kMaxUsed) return;
  }
  if (!writes_) return;
  if (const int code = change([](Transaction<State>&) { return 0; }); code != 0 && code != MDB_MAP_FULL)
    failed(code, 0);
}

void RangeCache::forget(const PieceId& id) {
  if (!warned_of_damage_.exchange(true))
    warn("a damaged piece was thrown away; look at this disk when it happens again");
  if (!writes_) return;
  const int code = change([&](Transaction<State>& transaction) { return transaction.remove(id); });
  if (code != 0 && code != MDB_MAP_FULL) failed(code, 0);
}

void RangeCache::put(const std::vector<std::pair<PieceId, base::ByteView>>& pieces) {
  std::uint64_t bytes = 0;
  for (const auto& [id, piece] : pieces) bytes += costOf(piece.size());
  if (!writes_ || bytes > options_.bytes / 2) return;
  environment_->dropDeadReaders();
  const auto keep_all = [&](Transaction<State>& transaction) {
    for (const auto& [id, piece] : pieces)
      if (const int code = transaction.keep(id, piece); code != 0) return code;
    return transaction.evictTo(options_.bytes);
  };
  int code = change(keep_all);
  // The map may be full although the budget is not: pages that went are free again only after a commit, and when no
  // reader looks at them. So room is made first; when that does not help, these pieces are not kept.
  if (code == MDB_MAP_FULL) {
    evictTo(options_.bytes / 8 * 7);
    code = change(keep_all);
  }
  if (code != 0 && code != MDB_MAP_FULL) failed(code, bytes);
}

void RangeCache::evictTo(std::uint64_t bytes) {
  const int code = change([&](Transaction<State>& transaction) { return transaction.evictTo(bytes); });
  if (code != 0 && code != MDB_MAP_FULL) failed(code, 0);
}

// A full disk ends the writing; anything else that LMDB cannot do also the reading.
void RangeCache::failed(int code, std::uint64_t bytes) {
  const int reason = reasonOfFailedWrite(path_, code, bytes);
  const bool no_space = reason == ENOSPC || reason == EDQUOT || reason == EFBIG;
  if (!no_space) reads_ = false;
  if (!writes_.exchange(false)) return;
  const std::string why = reason > 0 ? std::strerror(reason) : mdb_strerror(reason);
  warn(no_space ? "nothing more is cached (" + why + "); free some space and start again"
                : "the cache is not used any more (" + why + "); start again, it is then checked");
}

std::uint64_t RangeCache::usedBytes() {
  std::uint64_t bytes = 0;
  const int code = environment_->read([&](MDB_txn* txn) {
    Transaction<State> transaction(txn, environment_.operator->());
    const int begun = transaction.begin();
    bytes = transaction.state.bytes;
    return begun;
  });
  return code == 0 ? bytes : 0;
}

}  // namespace repository
