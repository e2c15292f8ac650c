#pragma once
// Rows of groups and patches as bytes, which are the same in patch.lgp's tables and in the message that sends one
// group. docs/formats/patch.md, "Group row" and "Patch row". Private to lod/patch.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

inline constexpr std::size_t kGroupRowBytes = 56;
inline constexpr std::size_t kPatchRowBytes = 84;

void writeGroupRow(base::ByteWriter& out, const Group& group);
void writePatchRow(base::ByteWriter& out, const Patch& patch);
/// These check nothing: groupFault() and patchFault() tell what is wrong with a row by itself.
Group readGroupRow(base::ByteReader& in);
Patch readPatchRow(base::ByteReader& in);

/// Tells what is wrong with the numbers of group row `index` (not finite, negative, no patches, no parents); null if
/// nothing is.
const char* groupFault(const Group& group, std::uint32_t index);
/// Tells what is wrong with the numbers of a patch row; null if nothing is.
const char* patchFault(const Patch& patch);

/// Errors about a file's bytes name the place, the fault, and what to do.
base::Error damaged(const std::string& what);
base::Error groupError(std::size_t group, const std::string& what);
base::Error patchError(std::size_t patch, const std::string& what);

/// Whether one sphere contains the other, up to 1e-5 of the radius and 1e-6 of the centre's distance from the origin:
/// the rounding of float spheres.
bool contains(const base::Sphere& outer, const base::Sphere& inner);

}  // namespace lod::patch
