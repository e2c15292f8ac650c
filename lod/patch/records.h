#pragma once
// Rows of groups and patches as bytes, which are the same in patch.lgp's tables and in the message that sends one
// group. docs/formats/patch.md, "Group row" and "Patch row". Private to lod/patch.
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/fields.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

inline constexpr std::uint32_t kFileHeaderBytes = 96;
inline constexpr std::size_t kGroupRowBytes = 68;
inline constexpr std::size_t kPatchRowBytes = 84;
/// Behind the rows in a message, for each patch: its producer's error, typical and visible error.
inline constexpr std::size_t kOwnErrorBytes = 12;

/// The fields of a row in the order in which they are stored.
template <class Row>
auto fieldsOf(Row& row) {
  if constexpr (std::is_same_v<std::remove_const_t<Row>, Group>)
    return std::tie(row.bounds, row.error, row.attribute_error, row.typical_error, row.typical_color_error,
                    row.visible_error, row.level, row.first_patch, row.patch_count, row.first_parent, row.parent_count,
                    row.block_bytes, row.block_offset);
  else
    return std::tie(row.box, row.bounds, row.cone, row.producer, row.consumer, row.level, row.color_detail,
                    row.triangles, row.vertices, row.block_offset, row.block_bytes);
}

template <class Row>
void writeRow(base::ByteWriter& out, const Row& row) {
  base::writeFields(out, fieldsOf(row));
}
/// Checks nothing: groupFault() and patchFault() tell what is wrong with a row by itself.
template <class Row>
Row readRow(base::ByteReader& in) {
  Row row;
  base::readFields(in, fieldsOf(row));
  return row;
}

/// Tells what is wrong with the numbers of group row `index` (not finite, negative, no patches, no parents); null if
/// nothing is.
const char* groupFault(const Group& group, std::uint32_t index);
/// Tells what is wrong with the numbers of a patch row; null if nothing is.
const char* patchFault(const Patch& patch);

/// The same as an error, and whether the ranges that the row names lie within tables of so many patches and parents.
base::Result<void> checkGroupRow(const Group& group, std::uint32_t index, std::uint64_t patches, std::uint64_t parents);
/// Decodes a patch's bytes and compares the counts with its row.
base::Result<PatchGeometry> decodeRow(const Patch& row, base::ByteView bytes);

/// Errors about a file's bytes name the place, the fault, and what to do.
base::Error damaged(const std::string& problem);
base::Error groupError(std::size_t group, const std::string& problem);
base::Error patchError(std::size_t patch, const std::string& problem);

/// Whether one sphere contains the other, up to 1e-5 of the radius and 1e-6 of the centre's distance from the origin:
/// the rounding of float spheres.
bool contains(const base::Sphere& outer, const base::Sphere& inner);

}  // namespace lod::patch
