// The store on LMDB: values are copied out of short transactions, commits are durable, and there is one writer. The
// file lmdb_environment.cpp handles LMDB's other traps.
#include <fcntl.h>
#include <lmdb.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>
#include <tuple>
#include <utility>

#include "base/file.h"
#include "base/file_lock.h"
#include "repository/lmdb_environment.h"
#include "repository/store.h"

namespace repository {
namespace {

// Portions bound the memory of a walk and keep its transactions short, since a writer cannot reuse pages meanwhile.
constexpr std::size_t kPortionValues = 256;                  // values that forEach copies in one transaction …
constexpr std::size_t kPortionBytes = std::size_t{8} << 20;  // … and their bytes
constexpr std::size_t kPortionKeys = 65536;                  // keys that forEachKey copies in one transaction
constexpr double kLockPatience = 0.2;                        // seconds; isBeingWritten holds the lock for microseconds
const std::vector<const char*> kTables{"faces", "meta"};
constexpr std::size_t kFaces = 0, kMeta = 1;  // indices into kTables
const std::string kMetaKey = "parameters";

// ---- Keys ----

// A key as a cursor returns it, copied out of the map.
struct CopiedKey {
  std::size_t size = 0;
  NumberKey bytes{};
};

base::Result<FaceKey> keyFrom(const CopiedKey& copied) {
  const auto wrong = [](const std::string& problem) {
    return base::Error{base::ErrorCode::kInvalidInput, problem + "; delete the directory and build the images again"};
  };
  if (copied.size != 8) return wrong("a key of " + std::to_string(copied.size) + " bytes");
  const NumberKey& bytes = copied.bytes;
  std::uint64_t code = 0;
  for (std::size_t i = 0; i < 8; ++i) code = code << 8 | bytes[i];
  auto key = FaceKey::fromCode(code);
  return key ? key : wrong(key.error().message);
}

// ---- The writer's lock ----

// Locks writer.lock, which the system releases when its process dies. The file holds the writer's pid for the message
// that a second writer gets.
base::Result<base::FileDescriptor> lockForWriting(const std::string& directory) {
  const std::string path = directory + "/writer.lock";
  // isBeingWritten() holds the lock for a moment, hence the patience.
  auto lock = base::tryLockFile(path, kLockPatience);
  if (!lock && lock.error().code == base::ErrorCode::kBusy) {
    const std::string pid = base::readHolder(path);
    return base::Error{base::ErrorCode::kBusy, directory + " is being written by another process" +
                                                   (pid.empty() ? "" : " (pid " + pid + ")") +
                                                   "; wait for it or stop it"};
  }
  if (lock) base::writeHolder(*lock, std::to_string(::getpid()) + "\n");
  return lock;
}

// ---- The store ----

class LmdbStore final : public Store {
 public:
  LmdbStore(std::string path, std::shared_ptr<LmdbEnvironment> environment, base::FileDescriptor lock)
      : path_(std::move(path)), environment_(std::move(environment)), lock_(std::move(lock)) {}

  base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const override {
    const NumberKey bytes = bigEndian(key.code());
    return copyOf(kFaces, valueOf(bytes));
  }

  base::Result<std::optional<std::uint64_t>> valueBytes(const FaceKey& key) const override {
    const NumberKey bytes = bigEndian(key.code());
    MDB_val value{};
    LUMIGRID_ASSIGN_OR_RETURN(
        const bool found, read([&](MDB_txn* txn) { return environment_->get(txn, kFaces, valueOf(bytes), value); }));
    return found ? std::optional<std::uint64_t>(value.mv_size) : std::nullopt;
  }

  base::Result<void> putBatch(const std::vector<std::pair<FaceKey, base::Bytes>>& batch) override {
    if (!lock_) return readOnlyError();
    // Sorted neighbours fall on the same pages, which makes writing five times as fast. The sort is stable, so that of
    // two values for a key the last one stays.
    std::vector<std::pair<std::uint64_t, const base::Bytes*>> sorted;
    sorted.reserve(batch.size());
    std::size_t bytes_of_batch = 0;
    for (const auto& [key, value] : batch) {
      sorted.emplace_back(key.code(), &value);
      bytes_of_batch += value.size();
    }
    std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.first < b.first; });

    environment_->dropDeadReaders();
    return write(bytes_of_batch, [&](MDB_txn* txn) {
      for (const auto& [key, value] : sorted) {
        const NumberKey bytes = bigEndian(key);
        const int put = environment_->put(txn, kFaces, valueOf(bytes), valueOf(*value));
        if (put != 0) return put;
      }
      return 0;
    });
  }

  base::Result<void> erase(const std::vector<FaceKey>& keys) override {
    if (!lock_) return readOnlyError();
    return write(0, [&](MDB_txn* txn) {
      for (const FaceKey& key : keys) {
        const NumberKey bytes = bigEndian(key.code());
        const int erased = environment_->erase(txn, kFaces, valueOf(bytes));
        if (erased != 0 && erased != MDB_NOTFOUND) return erased;
      }
      return 0;
    });
  }

  base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const override {
    std::size_t bytes = 0;
    return forEachPortion<std::pair<FaceKey, base::Bytes>>(
        [&](const FaceKey& key, const MDB_val& value, auto& portion) {
          if (portion.empty()) bytes = 0;
          portion.emplace_back(key, base::Bytes());
          bytes += value.mv_size;
          const int code = environment_->copy(value, portion.back().second);
          return std::pair(code, portion.size() < kPortionValues && bytes < kPortionBytes);
        },
        [&](const auto& row) { return visit(row.first, row.second); }, [](const auto& row) { return row.first; });
  }

  base::Result<void> forEachKey(const std::function<bool(const FaceKey&)>& visit) const override {
    return forEachPortion<FaceKey>(
        [](const FaceKey& key, const MDB_val&, auto& portion) {
          portion.push_back(key);
          return std::pair(0, portion.size() < kPortionKeys);
        },
        visit, [](const FaceKey& key) { return key; });
  }

  base::Result<std::uint64_t> size() const override {
    MDB_stat stat{};
    const int code = environment_->read([&](MDB_txn* txn) {
      return environment_->guarded([&] { return mdb_stat(txn, environment_->table(kFaces), &stat); });
    });
    if (code != 0) return storeError(path_, "read", code);
    return std::uint64_t{stat.ms_entries};
  }

  base::Result<std::optional<std::string>> readMeta() const override {
    LUMIGRID_ASSIGN_OR_RETURN(const auto value, copyOf(kMeta, valueOf(kMetaKey)));
    if (!value) return std::optional<std::string>();
    return std::optional<std::string>(std::string(value->begin(), value->end()));
  }

  base::Result<void> writeMeta(const std::string& text) override {
    if (!lock_) return readOnlyError();
    return write(0, [&](MDB_txn* txn) { return environment_->put(txn, kMeta, valueOf(kMetaKey), valueOf(text)); });
  }

 private:
  base::Result<std::optional<base::Bytes>> copyOf(std::size_t table, MDB_val name) const {
    base::Bytes bytes;
    LUMIGRID_ASSIGN_OR_RETURN(const auto found, read([&](MDB_txn* txn) {
                                MDB_val value{};
                                const int code = environment_->get(txn, table, name, value);
                                return code == 0 ? environment_->copy(value, bytes) : code;
                              }));
    return found ? std::optional(std::move(bytes)) : std::nullopt;
  }

  // Visits keys from code `next` on; visit(key, value) returns an LMDB code and whether to go on. Returns MDB_NOTFOUND
  // when the end was reached. An invalid key ends the walk, and `keys` receives the error.
  template <class Visit>
  int visitFrom(MDB_txn* txn, std::uint64_t next, base::Result<void>& keys, const Visit& visit) const {
    MDB_cursor* raw = nullptr;
    const int opened = environment_->guarded([&] { return mdb_cursor_open(txn, environment_->table(kFaces), &raw); });
    if (opened != 0) return opened;
    const std::unique_ptr<MDB_cursor, decltype(&mdb_cursor_close)> cursor(raw, mdb_cursor_close);

    const NumberKey start = bigEndian(next);
    CopiedKey name{start.size(), start};
    MDB_val value{};
    int code = move(raw, MDB_SET_RANGE, name, value);
    for (bool more = true; code == 0 && more; code = more && code == 0 ? move(raw, MDB_NEXT, name, value) : code) {
      const auto key = keyFrom(name);
      if (!key) {
        keys = key.error();
        return 0;
      }
      std::tie(code, more) = visit(*key, value);
    }
    return code;
  }

  // Moves a cursor, from `name` where `operation` asks for that, and copies the key that it comes to.
  int move(MDB_cursor* cursor, MDB_cursor_op operation, CopiedKey& name, MDB_val& value) const {
    MDB_val key = valueOf(name.bytes);
    return environment_->guarded([&] {
      const int code = mdb_cursor_get(cursor, &key, &value, operation);
      if (code != 0) return code;
      name.size = key.mv_size;
      if (key.mv_size == name.bytes.size()) std::memcpy(name.bytes.data(), key.mv_data, key.mv_size);
      return 0;
    });
  }

  // Visits all rows in portions, so that no transaction is open while `visit` runs, however long it takes. `copy`
  // appends a row to the portion and returns an LMDB code and whether there is room for more.
  template <class Row, class Copy, class Visit, class KeyOf>
  base::Result<void> forEachPortion(const Copy& copy, const Visit& visit, const KeyOf& key_of) const {
    std::vector<Row> portion;
    for (std::uint64_t next = 0;;) {
      portion.clear();
      base::Result<void> keys;
      LUMIGRID_ASSIGN_OR_RETURN(const auto more, read([&](MDB_txn* txn) {
                                  return visitFrom(txn, next, keys, [&](const FaceKey& key, const MDB_val& value) {
                                    return copy(key, value, portion);
                                  });
                                }));
      for (const Row& row : portion)
        if (!visit(row)) return {};
      if (!keys) return base::within(path_, keys.error());
      if (!more) return {};
      next = key_of(portion.back()).code() + 1;
    }
  }

  // Returns false for MDB_NOTFOUND.
  template <class Body>
  base::Result<bool> read(const Body& body) const {
    const int code = environment_->read(body);
    if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
    return code == 0;
  }
  base::Error readOnlyError() const override {
    return {base::ErrorCode::kUnsupported, path_ + ": opened for reading only"};
  }
  template <class Body>
  base::Result<void> write(std::size_t bytes, const Body& body) {
    const int code = environment_->write(body);
    if (code != 0) return storeError(path_, "write", reasonOfFailedWrite(path_, code, bytes));
    return {};
  }

  std::string path_;
  std::shared_ptr<LmdbEnvironment> environment_;
  base::FileDescriptor lock_;  // held by a writer
};

// The canonical path of the directory, which a writer creates first.
base::Result<std::string> directoryOf(const std::string& path, StoreMode mode) {
  std::error_code failed;
  if (mode == StoreMode::kWrite) {
    std::filesystem::create_directories(path, failed);
    if (failed) return base::systemError(path, "make", failed.value());
  } else if (!isLmdbStore(path)) {
    return base::Error{base::ErrorCode::kNotFound, path + ": no image repository here; build it with lumigrid build"};
  }
  const std::filesystem::path real = std::filesystem::canonical(path, failed);
  if (failed) return base::systemError(path, "open", failed.value());
  if (isOnNetwork(real))
    return base::Error{base::ErrorCode::kUnsupported,
                       path + ": on a network file system, which LMDB cannot use; copy the scene to a local disk"};
  return real.string();
}

}  // namespace

base::Result<std::unique_ptr<Store>> openLmdbStore(const std::string& path, StoreMode mode,
                                                   const LmdbOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto directory, directoryOf(path, mode));
  base::FileDescriptor lock;
  if (mode == StoreMode::kWrite) {
    LUMIGRID_ASSIGN_OR_RETURN(lock, lockForWriting(directory));
  }

  LmdbEnvironmentOptions environment_options;
  environment_options.map_bytes = options.map_bytes;
  LUMIGRID_ASSIGN_OR_RETURN(auto environment, LmdbEnvironment::open(directory, environment_options));
  if (mode == StoreMode::kWrite) {
    if (environment->readOnly()) return storeError(path, "write", EROFS);
    LUMIGRID_TRY(environment->checkTrees(CheckDepth::kValues));
  }

  const int code = environment->openTables(kTables, mode == StoreMode::kWrite);
  if (code == MDB_NOTFOUND)
    return base::Error{base::ErrorCode::kNotFound,
                       path + ": the image repository is empty; build it with lumigrid build"};
  if (code != 0) return storeError(path, "open", code);
  return std::unique_ptr<Store>(std::make_unique<LmdbStore>(directory, std::move(environment), std::move(lock)));
}

bool isLmdbStore(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path + "/data.mdb", ignored);
}

bool isBeingWritten(const std::string& path) {
  const base::FileDescriptor file(::open((path + "/writer.lock").c_str(), O_RDONLY | O_CLOEXEC));
  return file && ::flock(file.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

base::Result<void> removeLmdbStore(const std::string& path) {
  std::error_code failed;
  if (!std::filesystem::is_directory(path, failed)) return {};
  LUMIGRID_ASSIGN_OR_RETURN(const auto lock, lockForWriting(path));
  for (const char* name : {"data.mdb", "lock.mdb", "writer.lock"}) {
    std::filesystem::remove(std::filesystem::path(path) / name, failed);
    if (failed) return base::systemError(path + "/" + name, "remove", failed.value());
  }
  std::filesystem::remove(path, failed);  // fails unless it is empty: other files in it are not ours
  return {};
}

}  // namespace repository
