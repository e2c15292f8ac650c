#pragma once
// Wraps an LMDB 0.9 environment and avoids its traps in one place (docs/formats/repository.md, "Using LMDB"): it sets
// the map size and the number of readers before opening, uses MDB_NOTLS, opens one environment per directory and
// process, checks files before LMDB trusts them, and reads the map under guards, since a file that is cut while it is
// mapped would otherwise end the process (docs/decisions/reads-that-cannot-kill.md).
#include <lmdb.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/guard/guarded_read.h"

namespace repository {

/// Besides LMDB's own codes: the map could not be read. LMDB's lie between -30799 and -30780.
inline constexpr int kReadFault = -30600;

struct LmdbEnvironmentOptions {
  /// Address space for the map; less where the system refuses so much.
  std::uint64_t map_bytes = std::uint64_t{64} << 30;
  /// A write doubles a full map if this is set. Otherwise it fails with MDB_MAP_FULL, and the file never grows beyond
  /// the map.
  bool grows = true;
  /// A commit returns only when the disk has it. Without this a power cut may damage the whole file.
  bool durable = true;
};

/// kKeys reads the pages of keys. kValues, for writers, also reads the first page of each large value, whose header
/// LMDB trusts when it frees the value.
enum class CheckDepth { kKeys, kValues };

class LmdbEnvironment {
 public:
  /// Shares the one environment that this process has of a directory, or opens it and checks its trees
  /// (CheckDepth::kKeys). The last share closes it. `directory` is a canonical path (std::filesystem::canonical), so
  /// that two names cannot open one directory twice. The options of the first open one hold. One that has failed() is
  /// not shared any more: opening reads the file anew.
  static base::Result<std::shared_ptr<LmdbEnvironment>> open(const std::string& directory,
                                                             const LmdbEnvironmentOptions& options);

  /// Runs body(txn) in a read transaction. body returns an LMDB code and calls LMDB by the functions below. kReadFault
  /// from the first fault on, until the environment is opened anew.
  template <class Body>
  int read(const Body& body) {
    for (;;) {
      {
        const std::shared_lock lock(mapping_);
        if (const int code = usability(); code != 0) return code;
        MDB_txn* raw = nullptr;
        const int code = begin(MDB_RDONLY, &raw);
        const Txn txn(raw, {this});
        if (code == 0) return body(raw);
        if (code != MDB_MAP_RESIZED) return code;
      }
      if (const int code = adoptMap(); code != 0) return code;
    }
  }

  /// Runs body(txn) in a write transaction and commits it. When the map is full, both are repeated in a larger map.
  /// body as for read().
  template <class Body>
  int write(const Body& body) {
    for (;;) {
      const int code = writeOnce(body);
      const bool grow = code == MDB_MAP_FULL && grows_;
      if (!grow && code != MDB_MAP_RESIZED) return code;
      if (const int grown = grow ? growMap() : adoptMap(); grown != 0) return grown;
    }
  }

  /// Calls call(), which returns an LMDB code and may touch the map, but holds nothing with a destructor. kReadFault
  /// when the map could not be read; the environment has failed then.
  template <class Call>
  int guarded(const Call& call) {
    int code = kReadFault;
    if (base::guardedRead([&] { code = call(); })) return code;
    failed_ = true;
    return kReadFault;
  }
  /// As mdb_get, mdb_put (`data` may be null: mdb_del), each within a guard. Values lie in the map and are valid in the
  /// transaction, to be copied by copy().
  int get(MDB_txn* txn, std::size_t table, MDB_val name, MDB_val& value);
  int put(MDB_txn* txn, std::size_t table, MDB_val name, MDB_val data);
  int erase(MDB_txn* txn, std::size_t table, MDB_val name);
  /// Copies a value out of the map. MDB_CORRUPTED for a value longer than the file.
  int copy(const MDB_val& value, base::Bytes& out);

  /// Whether the map could once not be read: the file was cut or the disk fails.
  bool failed() const { return failed_; }

  /// Errors: kInvalidInput when the file is damaged, kIo.
  base::Result<void> checkTrees(CheckDepth depth);
  /// Opens named tables and creates absent ones if `create`; otherwise an absent one gives MDB_NOTFOUND. Each call
  /// names the same tables.
  int openTables(const std::vector<const char*>& names, bool create);
  /// The i-th of these tables.
  MDB_dbi table(std::size_t i) const { return tables_[i]; }
  /// Frees the slots of readers that died, so that LMDB can reuse the pages that they held.
  void dropDeadReaders();
  bool readOnly() const { return read_only_; }
  ~LmdbEnvironment();

 private:
  struct CloseEnv {
    void operator()(MDB_env* env) const;
  };
  struct AbortTxn {
    LmdbEnvironment* environment;
    void operator()(MDB_txn* txn) const {
      environment->guarded([txn] { return mdb_txn_abort(txn), 0; });
    }
  };
  using Txn = std::unique_ptr<MDB_txn, AbortTxn>;

  template <class Body>
  int writeOnce(const Body& body) {
    const std::shared_lock lock(mapping_);
    if (const int code = usability(); code != 0) return code;
    MDB_txn* raw = nullptr;
    if (const int code = begin(0, &raw); code != 0) return code;
    Txn txn(raw, {this});
    const int code = body(raw);
    // A fault left LMDB in the middle of a change, where it would free cursors that are gone. The transaction is leaked
    // with the lock of writers, which the system takes back when this process ends.
    if (code == kReadFault) return static_cast<void>(txn.release()), code;
    return code != 0 ? code : commit(txn.release());
  }
  int usability() const { return failed_ ? kReadFault : broken_ ? MDB_PANIC : 0; }
  int begin(unsigned flags, MDB_txn** txn);
  int commit(MDB_txn* txn);
  static base::Result<std::unique_ptr<LmdbEnvironment>> openUnshared(const std::string& directory,
                                                                     const LmdbEnvironmentOptions& options);
  int openEnv(std::uint64_t map_bytes, unsigned flags);
  int growMap();
  int adoptMap();
  int setMap(std::size_t bytes);

  std::string directory_;
  std::shared_mutex mapping_;
  std::mutex opening_;
  std::unique_ptr<MDB_env, CloseEnv> env_;
  bool read_only_ = false;
  bool grows_ = true;
  bool broken_ = false;  // LMDB has lost its map and must not be called
  std::atomic<bool> failed_{false};
  bool tables_open_ = false;
  std::vector<MDB_dbi> tables_;
};

/// Turns an LMDB code into one line that says what to do.
base::Error storeError(const std::string& path, const std::string& action, int code);

/// LMDB reports a short write as EIO, which hides a full disk, a quota or a limit. This function asks the system for
/// that much room and returns the true reason.
int reasonOfFailedWrite(const std::string& path, int code, std::size_t bytes);

/// Whether a path lies on a network file system. LMDB's locks and map need a local disk; two machines would ruin the
/// store (lmdb.h, "Caveats").
bool isOnNetwork(const std::string& path);

/// A number as a key whose order of bytes, which LMDB sorts by, is the order of numbers.
using NumberKey = std::array<std::uint8_t, 8>;
inline NumberKey bigEndian(std::uint64_t number) {
  NumberKey bytes;
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(number >> (56 - 8 * i));
  return bytes;
}

/// LMDB's interface has no const pointers, even for what it only reads.
template <class Range>
MDB_val valueOf(const Range& range) {
  return {range.size(), const_cast<void*>(static_cast<const void*>(range.data()))};
}

inline base::ByteView viewOf(const MDB_val& value) {
  return {static_cast<const std::uint8_t*>(value.mv_data), value.mv_size};
}

}  // namespace repository
