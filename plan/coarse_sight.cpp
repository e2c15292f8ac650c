#include "plan/coarse_sight.h"

#include <algorithm>
#include <vector>

#include "lod/patch/codec.h"

namespace plan {
namespace {

/// The error of a patch's producer. The row of an unknown group is a default one; the patch itself, which came with its
/// consumer, then states the error.
float errorOf(const lod::patch::Hierarchy& hierarchy, const lod::patch::Patch& patch) {
  if (patch.producer == lod::patch::kNoGroup) return 0.0F;
  return hierarchy.isKnown(patch.producer) ? hierarchy.groups[patch.producer].error : patch.own_error;
}

}  // namespace

base::Result<lod::patch::ProxySight> makeCoarseSight(
    const lod::patch::Hierarchy& hierarchy, std::span<const std::uint32_t> groups,
    const std::function<base::ByteView(std::uint32_t group)>& block_of) {
  // The cut draws the patches whose producer is not expanded.
  std::vector<std::uint32_t> patches;
  float error = 0.0F;
  for (const std::uint32_t group : groups) {
    const lod::patch::Group& row = hierarchy.groups[group];
    for (std::uint32_t i = row.first_patch; i < row.first_patch + row.patch_count; ++i) {
      if (std::find(groups.begin(), groups.end(), hierarchy.patches[i].producer) != groups.end()) continue;
      patches.push_back(i);
      error = std::max(error, errorOf(hierarchy, hierarchy.patches[i]));
    }
  }
  return lod::patch::ProxySight::ofPatches(
      hierarchy, patches, error, [&](std::uint32_t i) -> base::Result<lod::patch::PatchGeometry> {
        const lod::patch::Patch& patch = hierarchy.patches[i];
        const base::ByteView block = block_of(patch.consumer);
        if (patch.block_offset > block.size() || patch.block_bytes > block.size() - patch.block_offset)
          return base::Error{base::ErrorCode::kInvalidInput, "a block is too short"};
        return lod::patch::decodePatch(block.subspan(patch.block_offset, patch.block_bytes));
      });
}

}  // namespace plan
