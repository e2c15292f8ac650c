#pragma once
// A table from face keys to values behind one small interface. One writer and any number of readers may use it at the
// same time, from several processes.
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/sampling/key.h"

namespace repository {

class Store {
 public:
  virtual ~Store() = default;
  /// Returns a copy of the value, or nullopt when the key is absent. Safe from any thread.
  virtual base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const = 0;
  /// Returns the result of get() for each key, in their order. A remote store reads neighbours together.
  virtual std::vector<base::Result<std::optional<base::Bytes>>> getMany(const std::vector<FaceKey>& keys) const {
    std::vector<base::Result<std::optional<base::Bytes>>> values;
    for (const FaceKey& key : keys) values.push_back(get(key));
    return values;
  }
  /// Bytes of a value, as a rule without reading it: 0 where only reading it would tell, nullopt when the key is
  /// absent.
  virtual base::Result<std::optional<std::uint64_t>> valueBytes(const FaceKey& key) const = 0;
  base::Result<bool> contains(const FaceKey& key) const {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, valueBytes(key));
    return bytes.has_value();
  }
  /// Writes all values or none; they are durable on return. Keys need not be sorted. One thread at a time may call it.
  virtual base::Result<void> putBatch(const std::vector<std::pair<FaceKey, base::Bytes>>&) { return readOnlyError(); }
  virtual base::Result<void> erase(const std::vector<FaceKey>&) { return readOnlyError(); }
  /// Visits every key and value in ascending order of keys, until `visit` returns false.
  virtual base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const = 0;
  /// Visits every key in ascending order, until `visit` returns false. Stores that can do so leave the values unread.
  virtual base::Result<void> forEachKey(const std::function<bool(const FaceKey&)>& visit) const {
    return forEach([&](const FaceKey& key, base::ByteView) { return visit(key); });
  }
  virtual base::Result<std::uint64_t> size() const = 0;
  /// The parameters that all values were made with, as a small JSON text. They are durable when writeMeta returns.
  virtual base::Result<std::optional<std::string>> readMeta() const = 0;
  virtual base::Result<void> writeMeta(const std::string&) { return readOnlyError(); }

 protected:
  /// Why the store cannot be written; kUnsupported.
  virtual base::Error readOnlyError() const = 0;
};

enum class StoreMode { kRead, kWrite };

struct LmdbOptions {
  /// Address space for the map; the file takes only the space of its values. The map grows when it is full, and begins
  /// smaller where the system refuses so much.
  std::uint64_t map_bytes = std::uint64_t{64} << 30;
};

/// Opens the LMDB in directory `path`, which a writer creates when it is absent. For a reader a directory without a
/// store is kNotFound. A second writer, of any process, is refused with kBusy. Handles of one process share one
/// environment, so a reader beside a writer is fine. forEach reads in portions, each in a transaction of its own: keys
/// written meanwhile may be seen or not. A handle must not cross fork(). The first opening in a process reads the whole
/// tree of keys (not the values) and refuses a damaged one.
base::Result<std::unique_ptr<Store>> openLmdbStore(const std::string& path, StoreMode mode,
                                                   const LmdbOptions& options = {});

/// Whether directory `path` holds the data file of such a store.
bool isLmdbStore(const std::string& path);
/// Whether a process, on any machine that shares the file system's locks, has it open for writing.
bool isBeingWritten(const std::string& path);

/// Removes the store, and its directory when nothing else is in it. Refused with kBusy while a process writes it; where
/// there is no store nothing happens. No handle of this process may be open.
base::Result<void> removeLmdbStore(const std::string& path);

}  // namespace repository
