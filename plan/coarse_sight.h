#pragma once
// What hides what, for who has no more of a scene than its coarse whole model: a client that reads a published scene by
// itself.
#include <cstdint>
#include <functional>
#include <span>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"

namespace plan {

/// Of the cut in which just these groups are expanded (coarseGroups), whose rows are known. `block_of`: a group's
/// block, as long as this runs. kInvalidInput for damaged bytes.
base::Result<lod::patch::ProxySight> makeCoarseSight(
    const lod::patch::Hierarchy& hierarchy, std::span<const std::uint32_t> groups,
    const std::function<base::ByteView(std::uint32_t group)>& block_of);

}  // namespace plan
