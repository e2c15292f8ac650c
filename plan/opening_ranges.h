#pragma once
// Which bytes of a published hierarchy show the scene for the first time. `lumigrid publish` says them in scene.json,
// so that a client asks for all of them at once: by the records alone it would ask for these, and then for the blocks,
// which over a thin link is half a second.
#include <cstddef>
#include <vector>

#include "base/byte_range.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace plan {

/// More are not written, and not read.
inline constexpr std::size_t kMaxOpeningRanges = 16;

struct OpeningRanges {
  /// The front of the records: the directory, the coarsest groups, and those of their chunks, 2 kB at least.
  base::FileRange records;
  /// The blocks of the coarsest groups (coarseGroups() of 20 kB) in patch.lgp, in order; 1 to kMaxOpeningRanges.
  std::vector<base::FileRange> blocks;
};

/// `hierarchy`: whole. `records`: what lod::patch::encodeRecords made of it. kInvalidInput where they are damaged.
base::Result<OpeningRanges> openingRanges(const lod::patch::Hierarchy& hierarchy, base::ByteView records);

}  // namespace plan
