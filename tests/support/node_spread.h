#pragma once
// Measures how far the nodes of a qsplat.lgq reach beyond their leaves: a node that joins leaves across a gap is larger
// than they are together, and covers background where it is drawn.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "lod/qsplat/blocks.h"

namespace support {

/// An inner node of the file, with sums over the leaves below it.
struct SpreadNode {
  base::Sphere sphere;        ///< as decoded
  std::uint32_t level = 0;    ///< the root is at 0
  std::uint64_t leaves = 0;   ///< below it
  double leaf_squares = 0.0;  ///< sum of the squared radii of the leaves, as decoded
  bool above_leaves = false;  ///< all of its children are leaves

  /// The root mean square of the leaves' radii, which stands for their spacing: neighbours touch.
  double spacing() const { return std::sqrt(leaf_squares / static_cast<double>(leaves)); }
  /// The radius over that of a disc as large as all the leaves' discs. About 1 for a round piece of a surface.
  double spread() const { return static_cast<double>(sphere.radius) / std::sqrt(leaf_squares); }
};

struct TreeSpread {
  std::vector<SpreadNode> inner;  ///< of the whole file, each behind the nodes below it
  std::vector<float> leaf_radii;  ///< as decoded, by size

  /// The largest radii in medians of the leaves': leaves of even size stand as far apart as their radius says.
  struct Largest {
    double leaf = 0.0;
    double above_leaves = 0.0;  ///< inner nodes all of whose children are leaves
    double any = 0.0;           ///< inner nodes above n leaves, over √n: n leaves fill a disc of √n radii
  };
  Largest largest() const {
    const auto median = static_cast<double>(leaf_radii[leaf_radii.size() / 2]);
    Largest out;
    out.leaf = static_cast<double>(leaf_radii.back()) / median;
    for (const SpreadNode& node : inner) {
      const double radii = static_cast<double>(node.sphere.radius) / median;
      if (node.above_leaves) out.above_leaves = std::max(out.above_leaves, radii);
      out.any = std::max(out.any, radii / std::sqrt(static_cast<double>(node.leaves)));
    }
    return out;
  }
};

/// Reads a whole intact file.
class SpreadReader {
 public:
  explicit SpreadReader(lod::qsplat::Blocks& blocks) : blocks_(blocks), layout_(blocks.header()) {}

  TreeSpread run() {
    const lod::qsplat::Header& header = blocks_.header();
    if (header.nodes > 1) (void)visit(lod::qsplat::kBlockBytes, 1, true, header.root, 0);
    std::sort(found_.leaf_radii.begin(), found_.leaf_radii.end());
    return std::move(found_);
  }

 private:
  struct Below {
    std::uint64_t leaves = 0;
    double leaf_squares = 0.0;
  };

  Below visit(std::uint64_t offset, std::uint32_t nodes, bool has_pointer, const base::Sphere& parent,
              std::uint32_t level) {
    using namespace lod::qsplat;
    const std::uint8_t* group = blocks_.find(offset / kBlockBytes) + offset % kBlockBytes;
    std::uint64_t end = has_pointer ? readPointer(group, nodes, layout_) : 0;
    Below all;
    for (std::uint32_t i = 0; i < nodes; ++i) {
      const Node node = readNode(group, i, layout_);
      const base::Sphere sphere = decodeSphere(parent, sphereTable()[node.sphereCode()]);
      Below below{1, static_cast<double>(sphere.radius) * static_cast<double>(sphere.radius)};
      if (!has_pointer || node.isLeaf()) {
        found_.leaf_radii.push_back(sphere.radius);
      } else {
        const std::uint64_t at = groupPlace(end, layout_.childBytes(node));
        end = at + layout_.childBytes(node);
        below = visit(at, node.children(), !node.childrenAreLeaves(), sphere, level + 1);
        found_.inner.push_back({sphere, level, below.leaves, below.leaf_squares, node.childrenAreLeaves()});
      }
      all.leaves += below.leaves;
      all.leaf_squares += below.leaf_squares;
    }
    return all;
  }

  lod::qsplat::Blocks& blocks_;
  const lod::qsplat::GroupLayout layout_;
  TreeSpread found_;
};

}  // namespace support
