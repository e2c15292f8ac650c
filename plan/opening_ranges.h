#pragma once
// Which bytes of a published hierarchy show the scene for the first time. `lumigrid publish` says them in scene.json,
// so that a client asks for all of them at once: by the tables alone it would ask for these, then for what they name,
// and then for the blocks, which over a thin link is a second.
#include <cstddef>
#include <functional>
#include <vector>

#include "base/byte_range.h"
#include "base/error.h"
#include "lod/patch/table_pages.h"

namespace plan {

/// More are not written, and not read.
inline constexpr std::size_t kMaxOpeningRanges = 16;

/// Returns the ranges of a patch.lgp that hold the records and blocks of the coarsest groups (coarseGroups() of 20 kB),
/// in the order in which a client wants them: table pages from the file's first byte on, then blocks; 1 to
/// kMaxOpeningRanges. `read` returns the bytes of a range of the file. Errors: kInvalidInput for damaged tables, and
/// those of `read`.
base::Result<std::vector<base::FileRange>> openingRanges(
    const std::function<base::Result<base::Bytes>(const base::FileRange&)>& read);

}  // namespace plan
