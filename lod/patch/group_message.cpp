// Writes one group as bytes and reads it back into a growing hierarchy.
#include <algorithm>

#include "lod/patch/format.h"
#include "lod/patch/records.h"

namespace lod::patch {

void encodeGroup(const Hierarchy& hierarchy, std::uint32_t group, base::ByteWriter& out) {
  LUMIGRID_CHECK_LT(std::size_t{group}, hierarchy.groups.size());
  LUMIGRID_CHECK(hierarchy.isKnown(group));
  const Group& row = hierarchy.groups[group];
  out.u32(group);
  writeRow(out, row);
  for (std::uint32_t i = 0; i < row.patch_count; ++i) writeRow(out, hierarchy.patches[row.first_patch + i]);
  for (std::uint32_t i = 0; i < row.patch_count; ++i) {
    const Patch& patch = hierarchy.patches[row.first_patch + i];
    const bool known = patch.producer < hierarchy.groups.size() && hierarchy.isKnown(patch.producer);
    out.f32(known ? hierarchy.groups[patch.producer].error : patch.own_error);
    out.f32(known ? hierarchy.groups[patch.producer].typical_error : patch.own_typical_error);
    out.f32(known ? hierarchy.groups[patch.producer].visible_error : patch.own_visible_error);
  }
  for (const std::uint32_t parent : hierarchy.parentsOf(group)) out.u32(parent);
}

namespace {

struct GroupMessage {
  std::uint32_t index = 0;
  Group group;
  std::vector<Patch> patches;
  std::vector<std::uint32_t> parents;
};

base::Error badGroup(std::uint32_t group, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "group " + std::to_string(group) + " as sent: " + problem};
}

base::Result<GroupMessage> readGroupMessage(base::ByteReader& in) {
  GroupMessage message;
  message.index = in.u32();
  message.group = readRow<Group>(in);
  // Memory is allocated only for rows whose bytes are there.
  const std::uint64_t needed = std::uint64_t{message.group.patch_count} * (kPatchRowBytes + kOwnErrorBytes) +
                               std::uint64_t{message.group.parent_count} * 4;
  if (!in.ok() || needed > in.remaining()) {
    in.fail();
    return badGroup(message.index, "cut short");
  }
  message.patches.resize(message.group.patch_count);
  for (Patch& patch : message.patches) patch = readRow<Patch>(in);
  for (Patch& patch : message.patches)
    patch.own_error = in.f32(), patch.own_typical_error = in.f32(), patch.own_visible_error = in.f32();
  message.parents.resize(message.group.parent_count);
  for (std::uint32_t& parent : message.parents) parent = in.u32();
  return message;
}

// Checks what can be checked of a group without the rest of the hierarchy.
base::Result<void> checkGroupMessage(const GroupMessage& message, std::uint32_t max_groups, std::uint32_t max_patches) {
  const std::uint32_t index = message.index;
  const Group& group = message.group;
  if (index >= max_groups) return badGroup(index, "the scene has " + std::to_string(max_groups) + " groups");
  if (const char* fault = groupFault(group, index)) return badGroup(index, fault);
  if (std::uint64_t{group.first_patch} + group.patch_count > max_patches)
    return badGroup(index, "the scene has " + std::to_string(max_patches) + " patches");

  std::uint64_t within = 0;
  for (const Patch& patch : message.patches) {
    if (const char* fault = patchFault(patch)) return badGroup(index, std::string("a patch: ") + fault);
    if (patch.consumer != index) return badGroup(index, "a patch names another consumer");
    if (patch.producer != kNoGroup && patch.producer >= max_groups)
      return badGroup(index, "a patch names a producer that the scene hasn't");
    for (const base::ErrorMeasure measure :
         {base::ErrorMeasure::kBound, base::ErrorMeasure::kShape, base::ErrorMeasure::kVisible}) {
      const float own = ownErrorOf(patch, measure);
      if (!(own >= 0.0F && own <= errorOf(group, measure)) || (patch.producer == kNoGroup && own != 0.0F))
        return badGroup(index, "a patch's own error is not between 0 and its consumer's");
    }
    if (patch.block_offset != within) return badGroup(index, "a patch's bytes are not where the patch before ends");
    within += patch.block_bytes;
  }
  if (within != group.block_bytes) return badGroup(index, "its block has not the length of its patches");

  std::vector<std::uint32_t> sorted = message.parents;
  std::sort(sorted.begin(), sorted.end());
  if (std::adjacent_find(sorted.begin(), sorted.end()) != sorted.end())
    return badGroup(index, "a parent is named twice");
  if (!sorted.empty() && sorted.back() >= index) return badGroup(index, "a parent has no smaller number");
  return {};
}

}  // namespace

base::Result<std::uint32_t> addGroup(base::ByteReader& in, Hierarchy& growing, std::uint32_t max_groups,
                                     std::uint32_t max_patches) {
  LUMIGRID_ASSIGN_OR_RETURN(auto message, readGroupMessage(in));
  LUMIGRID_TRY(checkGroupMessage(message, max_groups, max_patches));
  const std::uint32_t index = message.index;
  Group& group = message.group;
  if (index < growing.known.size() && growing.known[index] != 0) return index;

  // A patch that another group consumes already (a row with triangles) can't be consumed again.
  const std::size_t patches_end = std::size_t{group.first_patch} + group.patch_count;
  for (std::size_t p = group.first_patch; p < std::min(patches_end, growing.patches.size()); ++p)
    if (growing.patches[p].triangles != 0) return badGroup(index, "patch " + std::to_string(p) + " is another group's");

  // Grow the tables; parents go to the end of theirs.
  if (growing.groups.size() <= index) growing.groups.resize(std::size_t{index} + 1);
  if (growing.known.size() < growing.groups.size()) growing.known.resize(growing.groups.size(), 0);
  if (growing.patches.size() < patches_end) growing.patches.resize(patches_end);
  group.first_parent = static_cast<std::uint32_t>(growing.parents.size());
  growing.parents.insert(growing.parents.end(), message.parents.begin(), message.parents.end());
  std::copy(message.patches.begin(), message.patches.end(), growing.patches.begin() + group.first_patch);
  growing.groups[index] = group;
  growing.known[index] = 1;
  return index;
}

}  // namespace lod::patch
