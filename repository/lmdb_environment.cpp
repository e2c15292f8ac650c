#include "repository/lmdb_environment.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstring>
#include <list>
#include <optional>
#include <tuple>
#include <vector>

#include "base/bytes.h"
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
// Values up to here are copied without a look at the file's length, which takes a system call.
constexpr std::size_t kUsualValueBytes = std::size_t{1} << 20;

// ---- Checks ----

// LMDB trusts its file, and a wild page number in a damaged one makes it crash. These checks read the file before LMDB
// does, by position and not through a map, so that a file that is cut meanwhile is an error.
//
// This is the layout of an LMDB 0.9 file on a 64-bit little-endian machine, after its source (mdb.c: MDB_meta,
// MDB_page, MDB_node, MDB_db).
//
// clang-format off
//   page   u64 number, u16 pad, u16 flags, u16 lower, u16 upper, then u16 offsets of nodes up to `lower`;
//          the nodes lie from `upper` on
//   node   u16 low, u16 high, u16 flags, u16 key bytes, key, data
//          in a leaf low and high give the bytes of the data; in a branch low, high and flags give a page number
//   table  u32 pad, u16 flags, u16 depth, u64 branch pages, u64 leaf pages, u64 overflow pages, u64 entries, u64 root
//   meta   page header, u32 magic, u32 version, u64 address, u64 map size, table of free pages, main table,
//          u64 last page, u64 transaction
// clang-format on
//
// The pad of the free table is the page size. The main table holds the named tables as nodes of 48 bytes. A value too
// large for a node lies in overflow pages of its own: a page header, then the value.

constexpr std::uint32_t kLmdbMagic = 0xBEEFC0DE;
constexpr std::uint32_t kLmdbVersion = 1;
constexpr std::uint16_t kBranch = 0x01, kLeaf = 0x02, kOverflow = 0x04, kKindMask = 0x7F;  // page flags
constexpr std::uint16_t kBigData = 0x01, kSubTable = 0x02;                                 // node flags
constexpr std::uint16_t kIntegerKeys = 0x08;                                               // table flags
constexpr std::uint64_t kNoPage = ~std::uint64_t{0};
constexpr std::uint64_t kPageHeader = 16, kNodeHeader = 8, kTableRecordBytes = 48;
constexpr std::size_t kMetaBytes = kPageHeader + 24 + 2 * kTableRecordBytes + 16;
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 46;  // half of the address space of an x86-64 process
constexpr int kMaxDepth = 32;                                // CURSOR_STACK in mdb.c

struct Table {
  std::uint32_t pad = 0;
  std::uint16_t flags = 0;
  std::uint16_t depth = 0;
  std::uint64_t root = kNoPage;
};

struct Meta {
  Table free_pages;
  Table main;
  std::uint64_t last_page = 0;
  std::uint64_t txn_id = 0;
};

Table readTable(base::ByteReader& in) {
  Table table;
  table.pad = in.u32();
  table.flags = in.u16();
  table.depth = in.u16();
  in.bytes(32);
  table.root = in.u64();
  return table;
}

std::optional<Meta> readMeta(const base::PositionedFile& file, std::uint64_t offset) {
  std::array<std::uint8_t, kMetaBytes> bytes{};
  if (!file.readAt(offset, bytes)) return std::nullopt;
  base::ByteReader in(bytes);
  in.bytes(kPageHeader);
  const std::uint32_t magic = in.u32();
  const std::uint32_t version = in.u32();
  in.bytes(16);
  Meta meta;
  meta.free_pages = readTable(in);
  meta.main = readTable(in);
  meta.last_page = in.u64();
  meta.txn_id = in.u64();
  if (!in.ok() || magic != kLmdbMagic || (version & 0xFFFF) != kLmdbVersion) return std::nullopt;

  const std::uint32_t page_bytes = meta.free_pages.pad;
  const bool usable = std::has_single_bit(page_bytes) && page_bytes >= 512 && page_bytes <= 65536;
  if (!usable || meta.last_page < 1 || meta.last_page >= kMaxBytes / page_bytes) return std::nullopt;
  return meta;
}

base::Error damagedError(const std::string& directory, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput,
          directory + "/data.mdb is damaged (" + problem + "); delete the directory and build the images again"};
}

// Walks the trees, marks the pages that it reaches and keeps the first fault.
class TreeWalker {
 public:
  TreeWalker(const base::PositionedFile& file, const Meta& meta, CheckDepth depth)
      : file_(file),
        depth_(depth),
        page_bytes_(meta.free_pages.pad),
        last_page_(meta.last_page),
        pages_(std::min<std::uint64_t>(meta.last_page + 1, file.size() / page_bytes_)),
        reached_(pages_) {
    if (pages_ >= 2) reached_[0] = reached_[1] = true;  // the meta pages
  }

  void walkTrees(const Meta& meta) {
    walkTable(meta.main, true, 0);
    in_free_table_ = true;
    if ((meta.free_pages.flags & kIntegerKeys) == 0) fail("free list of another kind", 0);
    walkTable({0, 0, meta.free_pages.depth, meta.free_pages.root}, false, 0);
  }
  const std::string& fault() const { return fault_; }
  /// An error of the disk, or of a file that was cut since it was opened.
  const base::Result<void>& readResult() const { return read_; }

 private:
  struct Page {
    base::Bytes bytes;
    std::uint16_t lower = 0;
    std::uint16_t upper = 0;
    std::uint64_t nodes() const { return (lower - kPageHeader) / 2; }
  };

  void fail(const std::string& problem, std::uint64_t page) {
    if (fault_.empty()) fault_ = problem + " at page " + std::to_string(page);
  }

  base::Bytes readBytes(std::uint64_t offset, std::uint64_t count) {
    base::Bytes bytes(count);
    if (auto read = file_.readAt(offset, bytes); !read) {
      if (read_) read_ = read;
      fail("bytes that cannot be read", offset / page_bytes_);
    }
    return bytes;
  }

  // Marks pages as reached; false when one lies outside of the file or was reached before.
  bool markReached(std::uint64_t first, std::uint64_t count) {
    if (first >= pages_ || count > pages_ - first) return fail("a link out of the file", first), false;
    for (std::uint64_t page = first; page < first + count; ++page) {
      if (reached_[page]) return fail("a page in use twice", page), false;
      reached_[page] = true;
    }
    return true;
  }

  void walkTable(const Table& table, bool holds_tables, std::uint64_t from) {
    if (table.root == kNoPage) return;
    if (table.flags != 0 || table.depth < 1 || table.depth > kMaxDepth) return fail("a table of another kind", from);
    walkPage(table.root, table.depth, holds_tables);
  }

  void walkPage(std::uint64_t number, int depth, bool holds_tables) {
    if (!fault_.empty() || !markReached(number, 1)) return;
    const auto page = readPage(number, depth == 1 ? kLeaf : kBranch);
    if (!page) return;
    const std::uint64_t min_nodes = depth > 1 && !in_free_table_ ? 2 : 1;
    if (page->nodes() < min_nodes) return fail("a page without nodes", number);
    for (std::uint64_t i = 0; i < page->nodes() && fault_.empty(); ++i) walkNode(*page, number, i, depth, holds_tables);
  }

  std::optional<Page> readPage(std::uint64_t number, std::uint16_t kind) {
    Page page;
    page.bytes = readBytes(number * page_bytes_, page_bytes_);
    base::ByteReader in(page.bytes);
    const std::uint64_t own_number = in.u64();
    in.u16();
    const std::uint16_t flags = in.u16();
    page.lower = in.u16();
    page.upper = in.u16();
    if (own_number != number || (flags & kKindMask) != kind)
      return fail("a page of the wrong kind", number), std::nullopt;
    if (page.lower < kPageHeader || page.lower % 2 != 0 || page.lower > page.upper || page.upper > page_bytes_) {
      return fail("a page whose parts overlap", number), std::nullopt;
    }
    return page;
  }

  void walkNode(const Page& page, std::uint64_t number, std::uint64_t i, int depth, bool holds_tables) {
    const base::ByteView bytes(page.bytes);
    base::ByteReader offsets(bytes.subspan(kPageHeader + 2 * i));
    const std::uint64_t at = offsets.u16();
    if (at < page.upper || at % 2 != 0 || at + kNodeHeader > page_bytes_) return fail("a node out of its page", number);
    base::ByteReader in(bytes.subspan(at));
    const std::uint64_t low = in.u16();
    const std::uint64_t high = in.u16();
    const std::uint16_t flags = in.u16();
    const std::uint16_t key_bytes = in.u16();
    in.bytes(key_bytes);
    if (!in.ok()) return fail("a key out of its page", number);
    if (depth > 1) return walkPage(low | high << 16 | std::uint64_t{flags} << 32, depth - 1, holds_tables);
    walkData(in, low | high << 16, flags, number, holds_tables);
  }

  void walkData(base::ByteReader& in, std::uint64_t bytes, std::uint16_t flags, std::uint64_t number,
                bool holds_tables) {
    base::ByteView data;
    base::Bytes own;
    if (flags == kBigData) {
      const std::uint64_t first = in.u64();
      if (!in.ok()) return fail("a value's link out of its page", number);
      const std::uint64_t pages = (kPageHeader + bytes + page_bytes_ - 1) / page_bytes_;
      if (!markReached(first, pages)) return;
      if (depth_ == CheckDepth::kValues && !isOverflow(first, pages))
        return fail("a value's page of the wrong kind", first);
      if (holds_tables || in_free_table_) own = readBytes(first * page_bytes_ + kPageHeader, bytes);
      data = own;
    } else {
      data = in.bytes(bytes);
      if (!in.ok()) return fail("a value out of its page", number);
    }
    if (holds_tables != ((flags & kSubTable) != 0) || (flags & ~(kBigData | kSubTable)) != 0)
      return fail("a value of another kind", number);
    if (holds_tables) {
      if (data.size() != kTableRecordBytes) return fail("a table record of the wrong size", number);
      base::ByteReader record(data);
      walkTable(readTable(record), false, number);
    }
    if (in_free_table_) walkFreeList(data, number);
  }

  bool isOverflow(std::uint64_t number, std::uint64_t pages) {
    const base::Bytes header = readBytes(number * page_bytes_, kPageHeader);
    base::ByteReader in(header);
    const std::uint64_t own_number = in.u64();
    in.u16();
    const std::uint16_t flags = in.u16();
    return own_number == number && (flags & kKindMask) == kOverflow && in.u32() == pages;
  }

  // A free list is a count and then that many numbers of free pages in descending order.
  void walkFreeList(base::ByteView data, std::uint64_t number) {
    base::ByteReader in(data);
    const std::uint64_t count = in.u64();
    if (!in.ok() || count > in.remaining() / 8) return fail("a free list out of its page", number);
    std::uint64_t before = kNoPage;
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t page = in.u64();
      if (page >= before || page < 2) return fail("a free list out of order", number);
      if (page > last_page_) return fail("a free page out of the file", number);  // a writer would write to it
      if (page < pages_ && reached_[page]) return fail("a page in use and free", page);
      if (page < pages_) reached_[page] = true;
      before = page;
    }
  }

  const base::PositionedFile& file_;
  CheckDepth depth_;
  std::uint64_t page_bytes_;
  std::uint64_t last_page_;
  std::uint64_t pages_;  // pages up to last_page_ that the file has
  std::vector<bool> reached_;
  bool in_free_table_ = false;
  std::string fault_;
  base::Result<void> read_;
};

// Checks the two meta pages of `directory`/data.mdb before LMDB opens it, so that LMDB can work with their numbers. A
// file that is absent or empty passes, since LMDB creates it.
base::Result<void> checkLmdbHeader(const std::string& directory) {
  const auto file = base::PositionedFile::open(directory + "/data.mdb");
  if (!file)
    return file.error().code == base::ErrorCode::kNotFound ? base::Result<void>() : base::Result<void>(file.error());
  if (file->size() == 0) return {};
  const auto first = readMeta(*file, 0);
  if (!first) return damagedError(directory, "its first meta page is none");
  const auto second = readMeta(*file, first->free_pages.pad);
  if (!second || second->free_pages.pad != first->free_pages.pad)
    return damagedError(directory, "its second meta page is none");
  return {};
}

// Walks the trees of transaction `txn_id`, which the caller holds open for reading. Every page reached must lie in the
// file, be of the kind that its place needs, be reached once and not be free; every node must lie in its page and
// every value in the file. Errors: kInvalidInput; kBusy when a writer has overwritten that transaction's meta page,
// after which the caller begins a new transaction and tries again.
base::Result<void> checkLmdbTrees(const std::string& directory, std::uint64_t txn_id, CheckDepth depth) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(directory + "/data.mdb"));
  const auto first = readMeta(file, 0);
  const auto second = first ? readMeta(file, first->free_pages.pad) : first;
  if (!first || !second) return damagedError(directory, "no meta page");
  const Meta& meta = first->txn_id == txn_id ? *first : *second;
  if (meta.txn_id != txn_id)
    return base::Error{base::ErrorCode::kBusy, directory + ": its writer is quicker than we can look; try again"};
  TreeWalker walker(file, meta, depth);
  walker.walkTrees(meta);
  LUMIGRID_TRY(walker.readResult());
  if (!walker.fault().empty()) return damagedError(directory, walker.fault());
  return {};
}

// ---- Files and locks ----

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
/// Tells a directory's store from one that took its place under the same name, which LMDB may well open beside it.
struct FileIdentity {
  dev_t device = 0;
  ino_t file = 0;
  friend bool operator==(const FileIdentity&, const FileIdentity&) = default;
};

FileIdentity storeFileOf(const std::string& directory) {
  struct stat status {};
  if (::stat((directory + "/data.mdb").c_str(), &status) != 0) return {};
  return {status.st_dev, status.st_ino};
}

struct SharedEnvironment {
  std::string directory;
  FileIdentity file;
  std::unique_ptr<LmdbEnvironment> environment;
  int shares = 0;
};
struct Registry {
  std::mutex mutex;
  std::list<SharedEnvironment> open;
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
    case kReadFault:
      return {ErrorCode::kIo, path + "/data.mdb: a read failed: the file was cut or the disk fails"};
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
  // A page that makes no sense ends the call as one that cannot be read does. All calls are guarded.
  mdb_env_set_assert(raw, [](MDB_env*, const char*) { base::leaveGuard(); });
  return guarded([&] { return mdb_env_open(raw, directory_.c_str(), MDB_NOTLS | flags, 0644); });
}

void LmdbEnvironment::CloseEnv::operator()(MDB_env* env) const {
  std::ignore = base::guardedRead([env] { mdb_env_close(env); });
}

// A failed environment is never closed: the call that failed may have left a lock or a transaction in it.
LmdbEnvironment::~LmdbEnvironment() {
  static std::vector<MDB_env*>* const given_up = new std::vector<MDB_env*>;
  static std::mutex mutex;
  if (!failed_ || !env_) return;
  const std::lock_guard guard(mutex);
  given_up->push_back(env_.release());
}

int LmdbEnvironment::begin(unsigned flags, MDB_txn** txn) {
  return guarded([&] { return mdb_txn_begin(env_.get(), nullptr, flags, txn); });
}

int LmdbEnvironment::commit(MDB_txn* txn) {
  return guarded([txn] { return mdb_txn_commit(txn); });
}

int LmdbEnvironment::get(MDB_txn* txn, std::size_t table, MDB_val name, MDB_val& value) {
  return guarded([&] { return mdb_get(txn, tables_[table], &name, &value); });
}

int LmdbEnvironment::put(MDB_txn* txn, std::size_t table, MDB_val name, MDB_val data) {
  return guarded([&] { return mdb_put(txn, tables_[table], &name, &data, 0); });
}

int LmdbEnvironment::erase(MDB_txn* txn, std::size_t table, MDB_val name) {
  return guarded([&] { return mdb_del(txn, tables_[table], &name, nullptr); });
}

int LmdbEnvironment::copy(const MDB_val& value, base::Bytes& out) {
  if (value.mv_size > kUsualValueBytes) {
    mdb_filehandle_t file = -1;
    struct stat info {};
    if (mdb_env_get_fd(env_.get(), &file) != 0 || ::fstat(file, &info) != 0) return EIO;
    if (value.mv_size > static_cast<std::uint64_t>(info.st_size)) return MDB_CORRUPTED;
  }
  out.resize(value.mv_size);
  if (out.empty()) return 0;
  return guarded([&] { return std::memcpy(out.data(), value.mv_data, value.mv_size), 0; });
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
  auto& open = registry().open;
  const FileIdentity file = storeFileOf(directory);
  auto it = std::find_if(open.begin(), open.end(), [&](const SharedEnvironment& one) {
    return one.directory == directory && one.file == file && !one.environment->failed();
  });
  if (it == open.end()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto opened, openUnshared(directory, options));
    it = open.insert(open.end(), {directory, storeFileOf(directory), std::move(opened)});
  }
  ++it->shares;
  const auto close_share = [it](LmdbEnvironment*) {
    const std::lock_guard closing(registry().mutex);
    if (--it->shares == 0) registry().open.erase(it);
  };
  return std::shared_ptr<LmdbEnvironment>(it->environment.get(), close_share);
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
      if (const int code = guarded([&] { return mdb_dbi_open(txn, names[i], flags, &tables_[i]); }); code != 0)
        return code;
    return 0;
  };
  int code = 0;
  if (create) {
    code = write([&](MDB_txn* txn) { return open_all(txn, MDB_CREATE); });
  } else {
    // A table's handle outlives its transaction only if that is committed.
    const std::shared_lock lock(mapping_);
    MDB_txn* raw = nullptr;
    code = begin(MDB_RDONLY, &raw);
    Txn txn(raw, {this});
    if (code == 0) code = open_all(raw, 0);
    if (code == 0) code = commit(txn.release());
  }
  tables_open_ = code == 0;
  return code;
}

void LmdbEnvironment::dropDeadReaders() {
  int dead = 0;
  if (!failed_) guarded([&] { return mdb_reader_check(env_.get(), &dead); });
}

// The map may change only while no transaction of this process runs. LMDB would be left without any map if the system
// refused the new one, so a trial map asks the system first.
int LmdbEnvironment::growMap() {
  const std::unique_lock lock(mapping_);
  if (const int code = usability(); code != 0) return code;
  MDB_envinfo info{};
  if (const int code = guarded([&] { return mdb_env_info(env_.get(), &info); }); code != 0) return code;
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
  if (const int code = usability(); code != 0) return code;
  const int code = guarded([&] { return mdb_env_set_mapsize(env_.get(), bytes); });
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
