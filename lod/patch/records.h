#pragma once
// Rows of groups and patches as bytes: the same in patch.lgp's tables and in the message that sends one group.
// docs/formats/patch.md, "Group row" and "Patch row". Private to lod/patch.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

inline constexpr std::size_t kGroupRowBytes = 56;
inline constexpr std::size_t kPatchRowBytes = 84;

void writeGroupRow(base::ByteWriter& out, const Group& group);
void writePatchRow(base::ByteWriter& out, const Patch& patch);
/// Unchecked: groupFault and patchFault say what is wrong with a row by itself.
Group readGroupRow(base::ByteReader& in);
Patch readPatchRow(base::ByteReader& in);

/// What is wrong with the numbers of group row `index`, or null: not finite, negative, no patches, no parents.
const char* groupFault(const Group& group, std::uint32_t index);
/// What is wrong with the numbers of a patch row, or null.
const char* patchFault(const Patch& patch);

/// Errors about a file's bytes: place, what is wrong, what to do.
base::Error damaged(const std::string& what);
base::Error groupError(std::size_t group, const std::string& what);
base::Error patchError(std::size_t patch, const std::string& what);

/// Up to the rounding of float spheres: a hundred-thousandth of the radius, and the last places of the centre.
bool contains(const base::Sphere& outer, const base::Sphere& inner);

}  // namespace lod::patch
