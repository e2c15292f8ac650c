#pragma once
// Builds the occlusion test (lod::patch::ProxySight) of a client that reads a published scene by itself and so far
// holds no more than the scene's coarse whole model.
#include <cstdint>
#include <functional>
#include <span>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"

namespace plan {

/// Uses the cut in which exactly `groups` (from coarseGroups) are expanded; the hierarchy must know their rows.
/// `block_of` returns a group's block, whose bytes must stay valid during the call. Errors: kInvalidInput for damaged
/// bytes.
base::Result<lod::patch::ProxySight> makeCoarseSight(
    const lod::patch::Hierarchy& hierarchy, std::span<const std::uint32_t> groups,
    const std::function<base::ByteView(std::uint32_t group)>& block_of);

}  // namespace plan
