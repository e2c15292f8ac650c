#pragma once
// Encodes a tile's tree from the top down: each sphere relative to its parent's decoded one (Rusinkiewicz and Levoy
// 2000, section 3.1), and the groups of each level one after the other.
#include <vector>

#include "base/bytes.h"
#include "lod/qsplat/builder/tree.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// The encoded groups of one level, until they are written. A group is a byte with its number of nodes, and bit 7 set
/// where it has a pointer, and then its nodes of 4 bytes, or of 6 with colours.
using Run = base::Bytes;
void appendGroup(Run& run, const GroupNodes& group, bool colors);
/// Reads the group that begins at `at`, and advances `at` behind it. A group without nodes marks the end, or damage.
GroupNodes readGroup(base::ByteView run, std::size_t& at, bool colors);

/// Returns a run for each level below the root; run 0 holds the root's children. `root` is the root's decoded sphere.
std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors,
                               LeafCones leaf_cones);

}  // namespace lod::qsplat::builder
