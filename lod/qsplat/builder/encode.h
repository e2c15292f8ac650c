#pragma once
// From the top down: spheres relative to their parents' decoded ones (Rusinkiewicz and Levoy 2000, section 3.1), and
// the groups of each level one after the other. Private to lod/build/qsplat.
#include <vector>

#include "base/bytes.h"
#include "lod/qsplat/builder/tree.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// The groups of one level in a row, as they wait for being written: for each a byte with its number of nodes, and bit
/// 7 where it has a pointer, then its nodes, 4 bytes each or 6 with colours.
using Run = base::Bytes;
void appendGroup(Run& run, const lod::qsplat::GroupNodes& group, bool colors);
/// The group that begins at `at`; `at` then stands behind it. Of no nodes at the end, or where there is none.
lod::qsplat::GroupNodes nextGroup(base::ByteView run, std::size_t& at, bool colors);

/// Level by level below the root (run 0: its children). `root` is the root's sphere as it will be decoded.
std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors,
                               LeafCones leaf_cones);

}  // namespace lod::qsplat::builder
