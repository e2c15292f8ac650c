#include "repository/lmdb_environment.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <map>

#include "base/file.h"

namespace repository {
namespace {

constexpr unsigned kMaxReaders = 1024;  // processes and threads, a choice: 64 bytes each; LMDB has 126 by default
constexpr unsigned kMaxTables = 4;      // the range cache has so many
constexpr off_t kLockBytes = 64 * (kMaxReaders + 3);  // lock.mdb has a header and 64 bytes a reader
constexpr std::uint64_t kMinMapBytes = std::uint64_t{1} << 30;
// Besides its values a batch writes pages of keys and free lists.
constexpr std::size_t kExtraWriteBytes = std::size_t{1} << 20;
constexpr int kCheckAttempts = 50;  // a writer may overtake the check a few times in a row

// Readers write to lock.mdb through a map, where a hole would raise SIGBUS on a full disk, so its blocks are allocated
// here. This must not happen while the file is open in this process: closing a second descriptor drops LMDB's locks.
base::Result<void> reserveLockFile(const std::string& directory) {
  const std::string path = directory + "/lock.mdb";
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return {};  // the directory may be read-only; LMDB reports what it cannot do
  const int code = ::posix_fallocate(fd, 0, kLockBytes);
  ::close(fd);
  if (code == ENOSPC || code == EDQUOT) return base::systemError(path, "make", code);
  return {};
}

// LMDB must not open a directory twice in one process, because its locks belong to the process. Handles therefore share
// environments, which are opened and closed under one mutex.
struct Registry {
  std::mutex mutex;
  std::map<std::string, std::pair<std::unique_ptr<LmdbEnvironment>, int>> open;  // and the number of shares
};
Registry& registry() {
  static Registry* const instance = new Registry;  // never destroyed: handles may outlive statics
  return *instance;
}

}  // namespace

// --- Errors

base::Error storeError(const std::string& path, const std::string& action, int code) {
  using base::ErrorCode;
  const auto say = [&](ErrorCode kind, const std::string& problem) {
    return base::Error{kind, path + ": cannot " + action + ": " + problem};
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

int reasonOfFailedWrite(const std::string& path, int code, std::size_t bytes) {
  if (code != EIO) return code;
  const int fd = ::open((path + "/data.mdb").c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) return code;
  struct stat info {};
  rlimit limit{};
  if (::fstat(fd, &info) == 0 && ::getrlimit(RLIMIT_FSIZE, &limit) == 0) {
    const auto size = static_cast<std::uint64_t>(info.st_size);
    const std::size_t room = bytes + kExtraWriteBytes;
    if (limit.rlim_cur != RLIM_INFINITY && size + room > limit.rlim_cur) {
      code = EFBIG;
    } else if (::fallocate(fd, FALLOC_FL_KEEP_SIZE, info.st_size, static_cast<off_t>(room)) != 0) {
      code = errno == ENOSPC || errno == EDQUOT || errno == EFBIG ? errno : EIO;
    }
  }
  ::close(fd);
  return code;
}

// --- The environment

int LmdbEnvironment::openEnv(std::uint64_t map_bytes, unsigned flags) {
  MDB_env* raw = nullptr;
  if (const int code = mdb_env_create(&raw); code != 0) return code;
  env_.reset(raw);
  mdb_env_set_mapsize(raw, map_bytes);
  mdb_env_set_maxreaders(raw, kMaxReaders);
  mdb_env_set_maxdbs(raw, kMaxTables);
  return mdb_env_open(raw, directory_.c_str(), MDB_NOTLS | flags, 0644);
}

base::Result<std::unique_ptr<LmdbEnvironment>> LmdbEnvironment::openUnshared(const std::string& directory,
                                                                             const LmdbEnvironmentOptions& options) {
  LUMIGRID_TRY(checkLmdbHeader(directory));
  LUMIGRID_TRY(reserveLockFile(directory));
  auto environment = std::make_unique<LmdbEnvironment>();
  environment->directory_ = directory;
  environment->grows_ = options.grows;
  const auto attempt = [&](unsigned flags) {
    int code = ENOMEM;
    // Where the system refuses that much address space, a smaller map serves until it must grow.
    for (std::uint64_t bytes = options.map_bytes;
         code == ENOMEM && (bytes == options.map_bytes || bytes >= kMinMapBytes); bytes /= 4) {
      code = environment->openEnv(bytes, flags);
    }
    return code;
  };

  // Readers open it read-write too, so that a writer of the same process can share it, but read-only on such a disk.
  int code = attempt(options.durable ? 0 : MDB_NOSYNC);
  if (code == EACCES || code == EROFS || code == EPERM) {
    environment->read_only_ = true;
    code = attempt(MDB_RDONLY);
  }
  if (code != 0) return storeError(directory, "open", code);
  environment->dropDeadReaders();

  LUMIGRID_TRY(environment->checkTrees(CheckDepth::kKeys));
  return environment;
}

base::Result<std::shared_ptr<LmdbEnvironment>> LmdbEnvironment::open(const std::string& directory,
                                                                     const LmdbEnvironmentOptions& options) {
  const std::lock_guard guard(registry().mutex);
  auto it = registry().open.find(directory);
  if (it == registry().open.end()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto opened, openUnshared(directory, options));
    it = registry().open.emplace(directory, std::pair(std::move(opened), 0)).first;
  }
  ++it->second.second;
  const auto close_share = [it](LmdbEnvironment*) {
    const std::lock_guard closing(registry().mutex);
    if (--it->second.second == 0) registry().open.erase(it);
  };
  return std::shared_ptr<LmdbEnvironment>(it->second.first.get(), close_share);
}

// A damaged tree would make LMDB follow wild links, so we walk it first. The open transaction keeps its pages from
// being reused meanwhile.
base::Result<void> LmdbEnvironment::checkTrees(CheckDepth depth) {
  base::Result<void> sound;
  for (int attempt = 0; attempt < kCheckAttempts; ++attempt) {
    const int code = read([&](MDB_txn* txn) {
      sound = checkLmdbTrees(directory_, mdb_txn_id(txn), depth);
      return 0;
    });
    if (code != 0) return storeError(directory_, "open", code);
    if (sound || sound.error().code != base::ErrorCode::kBusy) break;
  }
  return sound;
}

int LmdbEnvironment::openTables(const std::vector<const char*>& names, bool create) {
  const std::lock_guard opening(opening_);
  if (tables_open_) return 0;
  tables_.assign(names.size(), 0);
  const auto open_all = [&](MDB_txn* txn, unsigned flags) {
    for (std::size_t i = 0; i < names.size(); ++i)
      if (const int code = mdb_dbi_open(txn, names[i], flags, &tables_[i]); code != 0) return code;
    return 0;
  };
  int code = 0;
  if (create) {
    code = write([&](MDB_txn* txn) { return open_all(txn, MDB_CREATE); });
  } else {
    // A table's handle outlives its transaction only if that is committed.
    const std::shared_lock lock(mapping_);
    MDB_txn* raw = nullptr;
    code = mdb_txn_begin(env_.get(), nullptr, MDB_RDONLY, &raw);
    Txn txn(raw);
    if (code == 0) code = open_all(raw, 0);
    if (code == 0) code = mdb_txn_commit(txn.release());
  }
  tables_open_ = code == 0;
  return code;
}

void LmdbEnvironment::dropDeadReaders() {
  int dead = 0;
  mdb_reader_check(env_.get(), &dead);
}

// The map may change only while no transaction of this process runs. LMDB would be left without any map if the system
// refused the new one, so a trial map asks the system first.
int LmdbEnvironment::growMap() {
  const std::unique_lock lock(mapping_);
  MDB_envinfo info{};
  mdb_env_info(env_.get(), &info);
  const std::size_t bytes = info.me_mapsize * 2;
  void* const probe = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (probe == MAP_FAILED) return MDB_MAP_FULL;
  ::munmap(probe, bytes);
  return setMap(bytes);
}

// Adopts the larger map of another process.
int LmdbEnvironment::adoptMap() {
  const std::unique_lock lock(mapping_);
  return setMap(0);
}

int LmdbEnvironment::setMap(std::size_t bytes) {
  const int code = broken_ ? MDB_PANIC : mdb_env_set_mapsize(env_.get(), bytes);
  if (code != 0) broken_ = true;
  return code;
}

bool isOnNetwork(const std::string& path) {
  constexpr std::array<std::uint32_t, 3> kNetworks = {0x6969 /* NFS */, 0xFF534D42 /* CIFS */, 0xFE534D42 /* SMB2 */};
  struct statfs info {};
  return ::statfs(path.c_str(), &info) == 0 &&
         std::find(kNetworks.begin(), kNetworks.end(), static_cast<std::uint32_t>(info.f_type)) != kNetworks.end();
}

}  // namespace repository
