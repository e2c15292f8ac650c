#pragma once
// The patches built so far, on disk. The file is also the journal of the build: it has a record per finished bucket of
// leaves and per finished group, each with its checksum. A record is there whole or not at all, so a builder that was
// killed goes on behind the last whole one.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch::builder {

/// A leaf's triangle carries its number in the source, or ingest::kNoSource.
inline constexpr std::size_t kSourceBytes = sizeof(std::uint64_t);

/// A patch that is not in the store yet.
struct NewPatch {
  Patch record;                       ///< box, bounds, cone, counts, level
  std::vector<std::uint64_t> border;  ///< Morton codes of the vertices it may share with other patches, ascending
  base::Bytes encoded;                ///< by encodePatch()
  /// kErrorBytes for each triangle above the leaves, kSourceBytes at leaves of a source with textures; else empty.
  base::Bytes carried;
};

/// A patch in the store. Producer and consumer are numbered in the order in which groups are built.
struct WorkPatch {
  Patch record;
  std::uint64_t offset = 0;  ///< where its bytes lie in the store: border codes, encoded patch, carried bytes
  std::uint32_t border_codes = 0;
  std::uint32_t encoded_bytes = 0;
  std::uint32_t carried_bytes = 0;
};

/// One finished unit of work: the leaves of a bucket (level 0), or the products of a group (their level).
struct WorkUnit {
  std::uint32_t level = 0;
  std::uint32_t index = 0;  ///< the bucket, or the group within its level
  Group group;              ///< bounds and errors; without meaning at level 0
};

class WorkStore {
 public:
  /// Creates the file, or with `resume` continues it behind its last whole record. Calls `found` for every record
  /// there, in the order of writing. Errors: kNoSpace, kIo.
  static base::Result<WorkStore> open(const std::string& path, bool resume,
                                      const std::function<void(const WorkUnit&, std::vector<WorkPatch>)>& found);

  /// Writes one record; safe from several threads. Returns the patches as they lie in the store.
  base::Result<std::vector<WorkPatch>> add(const WorkUnit& unit, std::vector<NewPatch> patches);
  /// The codes of the patch's border vertices, ascending. `codes` is written over.
  base::Result<void> readBorder(const WorkPatch& patch, std::vector<std::uint64_t>& codes) const;
  /// The encoded bytes of the patch.
  base::Result<base::Bytes> encoded(const WorkPatch& patch) const;
  /// The encoded bytes and behind them what its triangles carry: encoded_bytes + carried_bytes in all. `bytes` is
  /// written over.
  base::Result<void> readWhole(const WorkPatch& patch, base::Bytes& bytes) const;
  std::uint64_t bytes() const { return log_.size(); }

 private:
  ingest::RecordLog log_;
};

}  // namespace lod::patch::builder
