#pragma once
// The patches made so far, on disk, and the journal of how far the work has come in one: a record per finished bucket
// of leaves and per finished group, each with its checksum. A record is there whole or not at all, so a builder that
// was killed goes on behind the last whole one.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/patch/builder/error_histogram.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch::builder {

/// A patch as its maker hands it over.
struct NewPatch {
  lod::patch::Patch record;           ///< box, bounds, cone, counts, level
  std::vector<std::uint64_t> border;  ///< Morton codes of the vertices it may share with other patches, ascending
  base::Bytes encoded;                ///< lod::patch::encodePatch
  base::Bytes errors;                 ///< what its triangles carry along (kErrorBytes each); empty for leaves
};

/// A patch in the store. Numbers of producer and consumer are of the order in which groups are made.
struct WorkPatch {
  lod::patch::Patch record;
  std::uint64_t offset = 0;  ///< of its bytes in the store: border codes, encoded, errors
  std::uint32_t border_codes = 0;
  std::uint32_t encoded_bytes = 0;
  std::uint32_t error_bytes = 0;
};

/// One piece of work: the leaves of a bucket (level 0), or what a group made (level of its products). A group that was
/// made again has two units; the second one's index is behind those of all groups of the level.
struct WorkUnit {
  std::uint32_t level = 0;
  std::uint32_t index = 0;  ///< of the bucket, or of the group within its level
  lod::patch::Group group;  ///< bounds and errors; of no meaning at level 0
  ErrorHistogram errors;    ///< of the group's products, in lattice steps and squares of them
};

class WorkStore {
 public:
  /// `path` is created, or continued behind its last whole record when `resume`. Every record found is told to `found`
  /// in the order in which they were written. Errors: kNoSpace, kIo.
  static base::Result<WorkStore> open(const std::string& path, bool resume,
                                      const std::function<void(const WorkUnit&, std::vector<WorkPatch>)>& found);

  /// Writes one record; safe from several threads. Returns the patches as they lie in the store.
  base::Result<std::vector<WorkPatch>> add(const WorkUnit& unit, std::vector<NewPatch> patches);
  /// The codes of its border vertices, as its maker gave them. `codes` is written over.
  base::Result<void> readBorder(const WorkPatch& patch, std::vector<std::uint64_t>& codes) const;
  /// The encoded bytes of a patch.
  base::Result<base::Bytes> encoded(const WorkPatch& patch) const;
  /// Those and behind them what its triangles carry along: encoded_bytes + error_bytes in all. `bytes` is written over.
  base::Result<void> readWhole(const WorkPatch& patch, base::Bytes& bytes) const;
  std::uint64_t bytes() const { return log_.size(); }

 private:
  ingest::RecordLog log_;
};

}  // namespace lod::patch::builder
