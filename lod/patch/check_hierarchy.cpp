// Checks what hierarchy.h promises, row by row and link by link.
#include <algorithm>
#include <compare>

#include "lod/patch/format.h"
#include "lod/patch/records.h"

namespace lod::patch {
namespace {

// Checks each row by itself, and that the rows' ranges lie within their tables and sum up to them.
base::Result<void> checkRows(const Hierarchy& h) {
  std::uint64_t consumed = 0;
  std::uint64_t parents = 0;
  for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
    const Group& group = h.groups[g];
    LUMIGRID_TRY(checkGroupRow(group, g, h.patches.size(), h.parents.size()));
    consumed += group.patch_count;
    parents += group.parent_count;
  }
  if (consumed != h.patches.size())
    return damaged("groups: together they consume " + std::to_string(consumed) + " of " +
                   std::to_string(h.patches.size()) + " patches");
  if (parents != h.parents.size())
    return damaged("groups: together they have " + std::to_string(parents) + " of " + std::to_string(h.parents.size()) +
                   " parents");

  for (std::size_t p = 0; p < h.patches.size(); ++p)
    if (const char* fault = patchFault(h.patches[p])) return patchError(p, fault);
  return {};
}

// A child group and a parent group that consumes one of its products.
struct Link {
  std::uint32_t child = 0;
  std::uint32_t parent = 0;
  auto operator<=>(const Link&) const =
      default;  // NOLINT(modernize-use-nullptr): clang-tidy 14 stumbles over a defaulted <=>
};

// Checks patches against the groups that they name. The sums agree (checkRows) and each patch has one consumer, so
// ranges cannot overlap.
base::Result<std::vector<Link>> checkPatches(const Hierarchy& h) {
  for (std::uint32_t g = 0; g < h.groups.size(); ++g)
    for (std::uint32_t i = 0; i < h.groups[g].patch_count; ++i)
      if (h.patches[h.groups[g].first_patch + i].consumer != g)
        return patchError(h.groups[g].first_patch + i,
                          "lies in the range of group " + std::to_string(g) + " but names another consumer");

  std::vector<Link> links;
  for (std::size_t p = 0; p < h.patches.size(); ++p) {
    const Patch& patch = h.patches[p];
    if (patch.consumer != 0 && patch.level >= h.groups[patch.consumer].level)
      return patchError(p, "its level is not below its consumer's");
    if (patch.producer == kNoGroup) continue;
    if (patch.producer >= h.groups.size()) return patchError(p, "its producer is not there");
    if (patch.level != h.groups[patch.producer].level) return patchError(p, "its level is not its producer's");
    links.push_back({patch.producer, patch.consumer});
  }
  std::sort(links.begin(), links.end());
  links.erase(std::unique(links.begin(), links.end()), links.end());
  return links;
}

// Checks that the table of parents agrees with the patches.
base::Result<void> checkParents(const Hierarchy& h, const std::vector<Link>& from_patches) {
  std::vector<Link> from_table;
  from_table.reserve(h.parents.size());
  for (std::uint32_t g = 0; g < h.groups.size(); ++g) {
    for (const std::uint32_t parent : h.parentsOf(g)) {
      if (parent >= g) return groupError(g, "its parent " + std::to_string(parent) + " has no smaller number");
      from_table.push_back({g, parent});
    }
  }
  std::sort(from_table.begin(), from_table.end());
  const auto [table, patches] =
      std::mismatch(from_table.begin(), from_table.end(), from_patches.begin(), from_patches.end());
  if (table == from_table.end() && patches == from_patches.end()) return {};
  const bool missing = table == from_table.end() || (patches != from_patches.end() && *patches < *table);
  const Link link = missing ? *patches : *table;
  return groupError(link.child, "group " + std::to_string(link.parent) +
                                    (missing ? " consumes what it produced but is not among its parents"
                                             : " is among its parents, twice or without consuming what it produced"));
}

base::Result<void> checkMonotone(const Hierarchy& h, const std::vector<Link>& links) {
  for (const Link& link : links) {
    const Group& child = h.groups[link.child];
    const Group& parent = h.groups[link.parent];
    const std::string name = std::to_string(link.parent);
    if (child.error > parent.error || child.typical_error > parent.typical_error ||
        child.visible_error > parent.visible_error)
      return groupError(link.child, "its error is larger than that of its parent " + name);
    if (!contains(parent.bounds, child.bounds))
      return groupError(link.child, "its sphere sticks out of that of its parent " + name);
  }
  return {};
}

}  // namespace

base::Result<void> checkHierarchy(const Hierarchy& hierarchy) {
  if (hierarchy.groups.empty() || hierarchy.patches.empty()) return damaged("no groups or no patches");
  LUMIGRID_TRY(checkRows(hierarchy));
  LUMIGRID_ASSIGN_OR_RETURN(const auto links, checkPatches(hierarchy));
  LUMIGRID_TRY(checkParents(hierarchy, links));
  return checkMonotone(hierarchy, links);
}

}  // namespace lod::patch
