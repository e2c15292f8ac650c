#pragma once
// From the top down: spheres relative to their parents' decoded ones (Rusinkiewicz and Levoy 2000, section 3.1), and
// the groups of each level one after the other. Private to lod/build/qsplat.
#include <vector>

#include "base/bytes.h"
#include "lod/build/qsplat/tree.h"

namespace lod::build::qsplat {

/// The groups of one level in a row, as they wait for being written: for each a byte with its number of nodes, then its
/// nodes, 4 bytes each or 6 with colours.
using Run = base::Bytes;
void appendGroup(Run& run, std::span<const lod::qsplat::Node> group, bool colors);
/// The group that begins at `at`; `at` then stands behind it. Empty at the end, or where there is none.
std::span<const lod::qsplat::Node> nextGroup(base::ByteView run, std::size_t& at, bool colors,
                                             std::array<lod::qsplat::Node, lod::qsplat::kMostChildren>& room);

/// Level by level below the root (run 0: its children). `root` is the root's sphere as it will be decoded.
std::vector<Run> encodeSubtree(std::span<const TreeNode> nodes, const base::Sphere& root, bool colors);

}  // namespace lod::build::qsplat
