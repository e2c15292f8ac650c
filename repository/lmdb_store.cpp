// The store on LMDB 0.9. Each of its traps (docs/formats/repository.md) is met once here: the map size and the number
// of readers are set before opening, MDB_NOTLS, one environment a process, copies out of short transactions, durable
// commits, one writer.
#include <fcntl.h>
#include <lmdb.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <climits>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <mutex>
#include <shared_mutex>
#include <string>
#include <thread>
#include <utility>

#include "base/file.h"
#include "repository/lmdb_check.h"
#include "repository/store.h"

namespace repository {
namespace {

constexpr unsigned kMaxReaders = 1024;
constexpr off_t kLockBytes = 64 * (kMaxReaders + 3);  // lock.mdb: a header and 64 bytes a reader
constexpr std::uint64_t kSmallestMap = std::uint64_t{1} << 30;
constexpr std::size_t kPortionValues = 256;                  // forEach: values copied in one transaction …
constexpr std::size_t kPortionBytes = std::size_t{8} << 20;  // … and their bytes
constexpr std::size_t kPortionKeys = 65536;                  // forEachKey: keys copied in one transaction
constexpr std::size_t kRoomBesides = std::size_t{1}
                                     << 20;  // what a batch writes besides its values: pages of keys, free lists
constexpr int kCheckAttempts = 50;           // a writer may overtake the check, but not that often
constexpr int kLockAttempts = 10;
constexpr std::chrono::milliseconds kLockPause(20);
const std::string kMetaKey = "parameters";

// --- Errors
// ------------------------------------------------------------------------------------------------------------------

base::Error storeError(const std::string& path, const std::string& action, int code) {
  using base::ErrorCode;
  const auto say = [&](ErrorCode kind, const std::string& what) {
    return base::Error{kind, path + ": cannot " + action + ": " + what};
  };
  switch (code) {
    case MDB_MAP_FULL:
      return say(ErrorCode::kNoSpace,
                 "the system gives the store no more address space; raise its limit (ulimit -v) and run the same "
                 "command again");
    case MDB_TXN_FULL:
      return say(ErrorCode::kNoSpace, "too much in one batch; write fewer values at once");
    case EFBIG:
      return say(ErrorCode::kNoSpace,
                 "the file may not grow any more; raise the limit (ulimit -f) or move the scene, and run the same "
                 "command again");
    case MDB_READERS_FULL:
      return say(ErrorCode::kBusy,
                 "all " + std::to_string(kMaxReaders) + " readers' places are taken; stop some programs that read it");
    case MDB_BAD_RSLOT:
      return say(ErrorCode::kBusy,
                 "a reader's place was used twice (MDB_BAD_RSLOT); close the store and open it again");
    case MDB_VERSION_MISMATCH:
      return say(ErrorCode::kVersion, "written by another version of LMDB; build the images again");
    case MDB_INVALID:
      return say(ErrorCode::kInvalidInput,
                 "data.mdb is not an LMDB file; delete the directory and build the images again");
    case MDB_PANIC:
      return say(ErrorCode::kIo, "an earlier write failed; close the store and open it again");
    default:
      break;
  }
  if (code > 0) return base::systemError(path, action, code);
  return say(ErrorCode::kInvalidInput,
             std::string(mdb_strerror(code)) + "; delete the directory and build the images again");
}

// LMDB calls a write that was cut short EIO, and so hides a full disk, a quota or a limit. To know, we ask for that
// room ourselves.
int reasonOfFailedWrite(const std::string& path, int code, std::size_t bytes) {
  if (code != EIO) return code;
  const int fd = ::open((path + "/data.mdb").c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) return code;
  struct stat info {};
  rlimit limit{};
  if (::fstat(fd, &info) == 0 && ::getrlimit(RLIMIT_FSIZE, &limit) == 0) {
    const auto size = static_cast<std::uint64_t>(info.st_size);
    const std::size_t room = bytes + kRoomBesides;
    if (limit.rlim_cur != RLIM_INFINITY && size + room > limit.rlim_cur) {
      code = EFBIG;
    } else if (::fallocate(fd, FALLOC_FL_KEEP_SIZE, info.st_size, static_cast<off_t>(room)) != 0) {
      code = errno == ENOSPC || errno == EDQUOT || errno == EFBIG ? errno : EIO;
    }
  }
  ::close(fd);
  return code;
}

base::Error openedForReading(const std::string& path) {
  return {base::ErrorCode::kUnsupported, path + ": opened for reading only"};
}

// --- Keys
// --------------------------------------------------------------------------------------------------------------------

// Big-endian, so that LMDB's byte order is Morton order.
using KeyBytes = std::array<std::uint8_t, 8>;

KeyBytes keyBytes(std::uint64_t code) {
  KeyBytes bytes;
  for (std::size_t i = 0; i < 8; ++i) bytes[i] = static_cast<std::uint8_t>(code >> (56 - 8 * i));
  return bytes;
}

base::Result<FaceKey> keyFrom(const MDB_val& value) {
  if (value.mv_size != 8)
    return base::Error{base::ErrorCode::kInvalidInput, "a key of " + std::to_string(value.mv_size) + " bytes"};
  const auto* bytes = static_cast<const std::uint8_t*>(value.mv_data);
  std::uint64_t code = 0;
  for (std::size_t i = 0; i < 8; ++i) code = code << 8 | bytes[i];
  return FaceKey::fromCode(code);
}

// LMDB takes pointers to what it only reads without const.
template <class Range>
MDB_val valueOf(const Range& range) {
  return {range.size(), const_cast<void*>(static_cast<const void*>(range.data()))};
}

base::ByteView viewOf(const MDB_val& value) {
  return {static_cast<const std::uint8_t*>(value.mv_data), value.mv_size};
}

// --- The environment: one for each directory and process
// ------------------------------------------------------------------------

struct CloseEnv {
  void operator()(MDB_env* env) const { mdb_env_close(env); }
};
struct AbortTxn {
  void operator()(MDB_txn* txn) const { mdb_txn_abort(txn); }
};
using Txn = std::unique_ptr<MDB_txn, AbortTxn>;

class Environment {
 public:
  static base::Result<std::shared_ptr<Environment>> open(const std::string& path, const LmdbOptions& options);

  // Runs body(txn) in a read transaction of this moment. body returns an LMDB code.
  template <class Body>
  int read(const Body& body) {
    for (;;) {
      {
        const std::shared_lock lock(mapping_);
        if (broken_) return MDB_PANIC;
        MDB_txn* raw = nullptr;
        const int code = mdb_txn_begin(env_.get(), nullptr, MDB_RDONLY, &raw);
        const Txn txn(raw);
        if (code == 0) return body(raw);
        if (code != MDB_MAP_RESIZED) return code;
      }
      if (const int code = adoptMap(); code != 0) return code;
    }
  }

  // Runs body(txn) in a write transaction and commits it durably; all of it again in a larger map when the map is full.
  template <class Body>
  int write(const Body& body) {
    for (;;) {
      const int code = writeOnce(body);
      if (code != MDB_MAP_FULL && code != MDB_MAP_RESIZED) return code;
      if (const int grown = code == MDB_MAP_FULL ? growMap() : adoptMap(); grown != 0) return grown;
    }
  }

  base::Result<void> checkTrees(const std::string& path, CheckDepth depth);
  // Opens (or makes) the two tables.
  int openTables(bool create);
  // Gives places of readers that died back, so that the pages they held can be used again.
  void dropDeadReaders() {
    int dead = 0;
    mdb_reader_check(env_.get(), &dead);
  }
  MDB_dbi faces() const { return faces_; }
  MDB_dbi meta() const { return meta_; }
  bool readOnly() const { return read_only_; }

 private:
  template <class Body>
  int writeOnce(const Body& body) {
    const std::shared_lock lock(mapping_);
    if (broken_) return MDB_PANIC;
    MDB_txn* raw = nullptr;
    if (const int code = mdb_txn_begin(env_.get(), nullptr, 0, &raw); code != 0) return code;
    Txn txn(raw);
    if (const int code = body(raw); code != 0) return code;
    return mdb_txn_commit(txn.release());
  }
  // The map may change only while no transaction of this process runs. LMDB is left without any map when the system
  // refuses the new one, so we ask the system first.
  int growMap() {
    const std::unique_lock lock(mapping_);
    MDB_envinfo info{};
    mdb_env_info(env_.get(), &info);
    const std::size_t bytes = info.me_mapsize * 2;
    void* const probe = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    if (probe == MAP_FAILED) return MDB_MAP_FULL;
    ::munmap(probe, bytes);
    return setMap(bytes);
  }
  // Another process has made the map larger.
  int adoptMap() {
    const std::unique_lock lock(mapping_);
    return setMap(0);
  }
  int setMap(std::size_t bytes) {
    const int code = broken_ ? MDB_PANIC : mdb_env_set_mapsize(env_.get(), bytes);
    if (code != 0) broken_ = true;
    return code;
  }

  std::shared_mutex mapping_;
  std::unique_ptr<MDB_env, CloseEnv> env_;
  bool read_only_ = false;
  bool broken_ = false;  // LMDB has lost its map
  bool tables_open_ = false;
  MDB_dbi faces_ = 0;
  MDB_dbi meta_ = 0;
};

// LMDB must not open a directory twice in one process (its locks are the process's), so handles share what is open.
// Opening and closing happen under one mutex.
struct Registry {
  std::mutex mutex;
  std::map<std::string, std::pair<std::shared_ptr<Environment>, int>> open;
};
Registry& registry() {
  static Registry* const instance = new Registry;  // never destroyed: handles may outlive statics
  return *instance;
}

// Readers take places in lock.mdb through a map: on a full disk a hole there would be SIGBUS, so its blocks are taken
// now. Never while it is open in this process: closing a second descriptor would drop LMDB's locks.
base::Result<void> reserveLockFile(const std::string& directory) {
  const std::string path = directory + "/lock.mdb";
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return {};  // a directory that may only be read; LMDB says what it thinks of it
  const int code = ::posix_fallocate(fd, 0, kLockBytes);
  ::close(fd);
  if (code == ENOSPC || code == EDQUOT) return base::systemError(path, "make", code);
  return {};
}

int openEnv(const std::string& path, std::uint64_t map_bytes, unsigned flags, std::unique_ptr<MDB_env, CloseEnv>& out) {
  MDB_env* raw = nullptr;
  if (const int code = mdb_env_create(&raw); code != 0) return code;
  out.reset(raw);
  mdb_env_set_mapsize(raw, map_bytes);
  mdb_env_set_maxreaders(raw, kMaxReaders);
  mdb_env_set_maxdbs(raw, 2);
  return mdb_env_open(raw, path.c_str(), MDB_NOTLS | flags, 0644);
}

base::Result<std::shared_ptr<Environment>> Environment::open(const std::string& path, const LmdbOptions& options) {
  LUMIGRID_TRY(checkLmdbHeader(path));
  LUMIGRID_TRY(reserveLockFile(path));
  auto environment = std::make_shared<Environment>();
  const auto attempt = [&](unsigned flags) {
    int code = ENOMEM;
    // Where the system refuses that much address space, a smaller map serves until it must grow.
    for (std::uint64_t bytes = options.map_bytes;
         code == ENOMEM && (bytes == options.map_bytes || bytes >= kSmallestMap); bytes /= 4) {
      code = openEnv(path, bytes, flags, environment->env_);
    }
    return code;
  };

  // Read-write even for readers, so that a writer of the same process can share it; read-only where the disk is.
  int code = attempt(0);
  if (code == EACCES || code == EROFS || code == EPERM) {
    environment->read_only_ = true;
    code = attempt(MDB_RDONLY);
  }
  if (code != 0) return storeError(path, "open", code);
  environment->dropDeadReaders();

  LUMIGRID_TRY(environment->checkTrees(path, CheckDepth::kKeys));
  return environment;
}

// A damaged tree would make LMDB follow wild links, so we walk it first; the transaction keeps its pages from being
// used again.
base::Result<void> Environment::checkTrees(const std::string& path, CheckDepth depth) {
  base::Result<void> sound;
  for (int attempt = 0; attempt < kCheckAttempts; ++attempt) {
    const int code = read([&](MDB_txn* txn) {
      sound = checkLmdbTrees(path, mdb_txn_id(txn), depth);
      return 0;
    });
    if (code != 0) return storeError(path, "open", code);
    if (sound || sound.error().code != base::ErrorCode::kBusy) break;
  }
  return sound;
}

int Environment::openTables(bool create) {
  if (tables_open_) return 0;
  const auto open_both = [&](MDB_txn* txn, unsigned flags) {
    if (const int code = mdb_dbi_open(txn, "faces", flags, &faces_); code != 0) return code;
    return mdb_dbi_open(txn, "meta", flags, &meta_);
  };
  int code = 0;
  if (create) {
    code = write([&](MDB_txn* txn) { return open_both(txn, MDB_CREATE); });
  } else {
    // A table's handle outlives its transaction only when that is committed.
    const std::shared_lock lock(mapping_);
    MDB_txn* raw = nullptr;
    code = mdb_txn_begin(env_.get(), nullptr, MDB_RDONLY, &raw);
    Txn txn(raw);
    if (code == 0) code = open_both(raw, 0);
    if (code == 0) code = mdb_txn_commit(txn.release());
  }
  tables_open_ = code == 0;
  return code;
}

// --- The writer's lock
// -----------------------------------------------------------------------------------------------------------

// An flock on writer.lock: the system gives it back when its process dies. The file holds the writer's pid, for the
// message only.
class WriterLock {
 public:
  static base::Result<WriterLock> take(const std::string& directory) {
    const std::string path = directory + "/writer.lock";
    WriterLock lock;
    lock.fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (lock.fd_ < 0) return base::systemError(path, "open", errno);
    // Whoever only looks whether it is taken (isBeingWritten) has it for a moment.
    int refused = ::flock(lock.fd_, LOCK_EX | LOCK_NB);
    for (int again = 0; refused != 0 && errno == EWOULDBLOCK && again < kLockAttempts; ++again) {
      std::this_thread::sleep_for(kLockPause);
      refused = ::flock(lock.fd_, LOCK_EX | LOCK_NB);
    }
    if (refused != 0) {
      if (errno != EWOULDBLOCK) return base::systemError(path, "lock", errno);
      return base::Error{base::ErrorCode::kBusy, directory + " is being written by another process" + lock.owner() +
                                                     "; wait for it or stop it"};
    }
    const std::string pid = std::to_string(::getpid()) + "\n";
    if (::ftruncate(lock.fd_, 0) == 0 && ::pwrite(lock.fd_, pid.data(), pid.size(), 0) < 0)
      errno = 0;  // a full disk may not stop us here
    return lock;
  }
  WriterLock() = default;
  WriterLock(WriterLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  WriterLock& operator=(WriterLock&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~WriterLock() {
    if (fd_ >= 0) ::close(fd_);
  }
  bool held() const { return fd_ >= 0; }

 private:
  std::string owner() const {
    std::array<char, 16> text{};
    const ssize_t size = ::pread(fd_, text.data(), text.size(), 0);
    if (size <= 0) return "";
    const std::string pid(text.data(), static_cast<std::size_t>(size));
    return " (pid " + pid.substr(0, pid.find('\n')) + ")";
  }
  int fd_ = -1;
};

// --- The store
// -------------------------------------------------------------------------------------------------------------------

class LmdbStore final : public Store {
 public:
  LmdbStore(std::string path, std::shared_ptr<Environment> environment, WriterLock lock)
      : path_(std::move(path)), environment_(std::move(environment)), lock_(std::move(lock)) {}

  ~LmdbStore() override {
    const std::lock_guard guard(registry().mutex);
    const auto it = registry().open.find(path_);
    environment_.reset();
    if (--it->second.second == 0) registry().open.erase(it);
  }

  base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const override {
    std::optional<base::Bytes> value;
    const KeyBytes bytes = keyBytes(key.code());
    const int code =
        environment_->read([&](MDB_txn* txn) { return copyOut(txn, environment_->faces(), valueOf(bytes), value); });
    if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
    return value;
  }

  base::Result<bool> contains(const FaceKey& key) const override {
    const KeyBytes bytes = keyBytes(key.code());
    const int code = environment_->read([&](MDB_txn* txn) {
      MDB_val name = valueOf(bytes);
      MDB_val value{};
      return mdb_get(txn, environment_->faces(), &name, &value);
    });
    if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
    return code == 0;
  }

  base::Result<void> putBatch(const std::vector<std::pair<FaceKey, base::Bytes>>& batch) override {
    if (!lock_.held()) return openedForReading(path_);
    // Sorted, neighbours fall on the same pages: five times the speed. Stable, so that of two values for a key the last
    // one stays.
    std::vector<std::pair<std::uint64_t, const base::Bytes*>> sorted;
    sorted.reserve(batch.size());
    std::size_t bytes_of_batch = 0;
    for (const auto& [key, value] : batch) {
      sorted.emplace_back(key.code(), &value);
      bytes_of_batch += value.size();
    }
    std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.first < b.first; });

    environment_->dropDeadReaders();
    const int code = environment_->write([&](MDB_txn* txn) {
      for (const auto& [key, value] : sorted) {
        const KeyBytes bytes = keyBytes(key);
        MDB_val name = valueOf(bytes);
        MDB_val data = valueOf(*value);
        if (const int put = mdb_put(txn, environment_->faces(), &name, &data, 0); put != 0) return put;
      }
      return 0;
    });
    if (code != 0) return storeError(path_, "write", reasonOfFailedWrite(path_, code, bytes_of_batch));
    return {};
  }

  base::Result<void> erase(const std::vector<FaceKey>& keys) override {
    if (!lock_.held()) return openedForReading(path_);
    const int code = environment_->write([&](MDB_txn* txn) {
      for (const FaceKey& key : keys) {
        const KeyBytes bytes = keyBytes(key.code());
        MDB_val name = valueOf(bytes);
        const int erased = mdb_del(txn, environment_->faces(), &name, nullptr);
        if (erased != 0 && erased != MDB_NOTFOUND) return erased;
      }
      return 0;
    });
    if (code != 0) return storeError(path_, "write", reasonOfFailedWrite(path_, code, 0));
    return {};
  }

  // In portions: `visit` may take its time, and no transaction is open while it runs.
  base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const override {
    std::vector<std::pair<FaceKey, base::Bytes>> portion;
    for (std::uint64_t next = 0;;) {
      portion.clear();
      base::Result<void> keys;
      const int code = environment_->read([&](MDB_txn* txn) { return copyPortion(txn, next, portion, keys); });
      if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
      for (const auto& [key, value] : portion) {
        if (!visit(key, value)) return {};
      }
      if (!keys) return base::within(path_, keys.error());
      if (code == MDB_NOTFOUND) return {};
      next = portion.back().first.code() + 1;
    }
  }

  base::Result<void> forEachKey(const std::function<bool(const FaceKey&)>& visit) const override {
    std::vector<FaceKey> portion;
    for (std::uint64_t next = 0;;) {
      portion.clear();
      base::Result<void> keys;
      const int code = environment_->read([&](MDB_txn* txn) { return copyKeys(txn, next, portion, keys); });
      if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
      for (const FaceKey& key : portion) {
        if (!visit(key)) return {};
      }
      if (!keys) return base::within(path_, keys.error());
      if (code == MDB_NOTFOUND) return {};
      next = portion.back().code() + 1;
    }
  }

  base::Result<std::uint64_t> size() const override {
    MDB_stat stat{};
    const int code = environment_->read([&](MDB_txn* txn) { return mdb_stat(txn, environment_->faces(), &stat); });
    if (code != 0) return storeError(path_, "read", code);
    return std::uint64_t{stat.ms_entries};
  }

  base::Result<std::optional<std::string>> readMeta() const override {
    std::optional<base::Bytes> value;
    const int code =
        environment_->read([&](MDB_txn* txn) { return copyOut(txn, environment_->meta(), valueOf(kMetaKey), value); });
    if (code != 0 && code != MDB_NOTFOUND) return storeError(path_, "read", code);
    if (!value) return std::optional<std::string>();
    return std::optional<std::string>(std::string(value->begin(), value->end()));
  }

  base::Result<void> writeMeta(const std::string& text) override {
    if (!lock_.held()) return openedForReading(path_);
    const int code = environment_->write([&](MDB_txn* txn) {
      MDB_val name = valueOf(kMetaKey);
      MDB_val data = valueOf(text);
      return mdb_put(txn, environment_->meta(), &name, &data, 0);
    });
    if (code != 0) return storeError(path_, "write", reasonOfFailedWrite(path_, code, 0));
    return {};
  }

 private:
  static int copyOut(MDB_txn* txn, MDB_dbi table, MDB_val name, std::optional<base::Bytes>& out) {
    MDB_val value{};
    if (const int code = mdb_get(txn, table, &name, &value); code != 0) return code;
    out.emplace(viewOf(value).begin(), viewOf(value).end());
    return 0;
  }

  // Visits keys from code `next` on while take(key, value) says so; MDB_NOTFOUND when the end was reached. A key that
  // is none ends the walk and is told in `keys`.
  template <class Take>
  int walk(MDB_txn* txn, std::uint64_t next, base::Result<void>& keys, const Take& take) const {
    MDB_cursor* raw = nullptr;
    if (const int code = mdb_cursor_open(txn, environment_->faces(), &raw); code != 0) return code;
    const std::unique_ptr<MDB_cursor, decltype(&mdb_cursor_close)> cursor(raw, mdb_cursor_close);

    const KeyBytes start = keyBytes(next);
    MDB_val name = valueOf(start);
    MDB_val value{};
    int code = mdb_cursor_get(raw, &name, &value, MDB_SET_RANGE);
    for (bool more = true; code == 0 && more; code = more ? mdb_cursor_get(raw, &name, &value, MDB_NEXT) : 0) {
      const auto key = keyFrom(name);
      if (!key) {
        keys = key.error();
        return 0;
      }
      more = take(*key, value);
    }
    return code;
  }

  int copyPortion(MDB_txn* txn, std::uint64_t next, std::vector<std::pair<FaceKey, base::Bytes>>& out,
                  base::Result<void>& keys) const {
    std::size_t bytes = 0;
    return walk(txn, next, keys, [&](const FaceKey& key, const MDB_val& value) {
      out.emplace_back(key, base::Bytes(viewOf(value).begin(), viewOf(value).end()));
      bytes += value.mv_size;
      return out.size() < kPortionValues && bytes < kPortionBytes;
    });
  }

  int copyKeys(MDB_txn* txn, std::uint64_t next, std::vector<FaceKey>& out, base::Result<void>& keys) const {
    return walk(txn, next, keys, [&](const FaceKey& key, const MDB_val&) {
      out.push_back(key);
      return out.size() < kPortionKeys;
    });
  }

  std::string path_;
  std::shared_ptr<Environment> environment_;
  WriterLock lock_;
};

// LMDB's locks and map need a local disk: on a network file system two machines would ruin the store (lmdb.h,
// "Caveats").
bool onNetwork(const std::string& path) {
  constexpr std::array<std::uint32_t, 3> kNetworks = {0x6969 /* NFS */, 0xFF534D42 /* CIFS */, 0xFE534D42 /* SMB2 */};
  struct statfs info {};
  return ::statfs(path.c_str(), &info) == 0 &&
         std::find(kNetworks.begin(), kNetworks.end(), static_cast<std::uint32_t>(info.f_type)) != kNetworks.end();
}

// The directory by its one true name, made first when it is to be written.
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
  if (onNetwork(real))
    return base::Error{base::ErrorCode::kUnsupported,
                       path + ": on a network file system, which LMDB cannot use; copy the scene to a local disk"};
  return real.string();
}

}  // namespace

base::Result<std::unique_ptr<Store>> openLmdbStore(const std::string& path, StoreMode mode,
                                                   const LmdbOptions& options) {
  auto directory = directoryOf(path, mode);
  if (!directory) return directory.error();
  WriterLock lock;
  if (mode == StoreMode::kWrite) {
    auto taken = WriterLock::take(*directory);
    if (!taken) return taken.error();
    lock = std::move(*taken);
  }

  const std::lock_guard guard(registry().mutex);
  std::shared_ptr<Environment> environment;
  if (const auto it = registry().open.find(*directory); it != registry().open.end()) {
    environment = it->second.first;
  } else {
    auto opened = Environment::open(*directory, options);
    if (!opened) return opened.error();
    environment = std::move(*opened);
  }
  if (mode == StoreMode::kWrite) {
    if (environment->readOnly()) return storeError(path, "write", EROFS);
    LUMIGRID_TRY(environment->checkTrees(*directory, CheckDepth::kValues));
  }

  const int code = environment->openTables(mode == StoreMode::kWrite);
  if (code == MDB_NOTFOUND)
    return base::Error{base::ErrorCode::kNotFound,
                       path + ": the image repository is empty; build it with lumigrid build"};
  if (code != 0) return storeError(path, "open", code);
  auto& entry = registry().open[*directory];
  entry.first = environment;
  ++entry.second;
  return std::unique_ptr<Store>(std::make_unique<LmdbStore>(*directory, std::move(environment), std::move(lock)));
}

bool isLmdbStore(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path + "/data.mdb", ignored);
}

bool isBeingWritten(const std::string& path) {
  const int fd = ::open((path + "/writer.lock").c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return false;
  const bool taken = ::flock(fd, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  ::close(fd);
  return taken;
}

base::Result<void> removeLmdbStore(const std::string& path) {
  std::error_code failed;
  if (!std::filesystem::is_directory(path, failed)) return {};
  auto lock = WriterLock::take(path);
  if (!lock) return lock.error();
  for (const char* name : {"data.mdb", "lock.mdb", "writer.lock"}) {
    std::filesystem::remove(std::filesystem::path(path) / name, failed);
    if (failed) return base::systemError(path + "/" + name, "remove", failed.value());
  }
  std::filesystem::remove(path, failed);  // only when empty: what else is there is not ours
  return {};
}

}  // namespace repository
