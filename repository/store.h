#pragma once
// A hash table from face key to bytes behind one small interface (DESIGN section 5). One writer, any number of readers,
// at the same time and from other processes.
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
  /// A copy of the value, or nullopt when the key is absent. From any thread.
  virtual base::Result<std::optional<base::Bytes>> get(const FaceKey& key) const = 0;
  /// One Result per key, in their order: what get() says of each. A store that is far away reads neighbours together.
  virtual std::vector<base::Result<std::optional<base::Bytes>>> getMany(const std::vector<FaceKey>& keys) const {
    std::vector<base::Result<std::optional<base::Bytes>>> values;
    for (const FaceKey& key : keys) values.push_back(get(key));
    return values;
  }
  virtual base::Result<bool> contains(const FaceKey& key) const = 0;
  /// All or nothing, durable on return. Keys need not be sorted. One thread at a time.
  virtual base::Result<void> putBatch(const std::vector<std::pair<FaceKey, base::Bytes>>& batch) = 0;
  virtual base::Result<void> erase(const std::vector<FaceKey>& keys) = 0;
  /// Every key and value in ascending key order, until `visit` returns false.
  virtual base::Result<void> forEach(const std::function<bool(const FaceKey&, base::ByteView)>& visit) const = 0;
  /// Every key in ascending order, until `visit` returns false; stores that can do so leave the values unread.
  virtual base::Result<void> forEachKey(const std::function<bool(const FaceKey&)>& visit) const {
    return forEach([&](const FaceKey& key, base::ByteView) { return visit(key); });
  }
  virtual base::Result<std::uint64_t> size() const = 0;
  /// The parameters that every value was made with (a small JSON text); writing them is durable.
  virtual base::Result<std::optional<std::string>> readMeta() const = 0;
  virtual base::Result<void> writeMeta(const std::string& text) = 0;
};

enum class StoreMode { kRead, kWrite };

struct LmdbOptions {
  /// Address space for the map; the file takes only what is stored. Grows by itself when full; smaller where the system
  /// refuses.
  std::uint64_t map_bytes = std::uint64_t{64} << 30;
};

/// LMDB in directory `path` (made when absent and mode is kWrite); a directory without a store is kNotFound for a
/// reader. A second writer, of any process, is refused with kBusy. Handles of one process share one environment: a
/// reader beside a writer is fine. forEach takes its values in portions, each of one moment: keys written meanwhile may
/// be seen or not. A handle must not cross fork(). The first opening in a process reads the whole tree of keys (not the
/// values) and refuses a damaged one.
base::Result<std::unique_ptr<Store>> openLmdbStore(const std::string& path, StoreMode mode,
                                                   const LmdbOptions& options = {});

/// Whether directory `path` holds (the file of) such a store.
bool isLmdbStore(const std::string& path);
/// Whether a process, of any machine that shares the file system's locks, has it open for writing just now.
bool isBeingWritten(const std::string& path);

/// Removes the store and, when nothing else is in it, its directory. Refused with kBusy while somebody writes it;
/// nothing happens where there is none. No handle of this process may be open.
base::Result<void> removeLmdbStore(const std::string& path);

}  // namespace repository
