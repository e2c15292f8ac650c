#pragma once
// Moves strays to where they belong. A tile follows the Morton curve, which jumps, so small pieces of surface may lie
// far from the rest of their tile, and of a scan some pieces always do. Such a stray hangs below a node that reaches
// across the gap; elsewhere, mostly in the tree of another tile, there is a node of its own size beside it.
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "base/error.h"
#include "lod/qsplat/builder/editable_tree.h"

namespace lod::qsplat::builder {

/// A small tree that may be better off elsewhere.
struct Stray {
  std::uint32_t node = 0;       ///< its number in its tile's tree
  float gap = 0.0F;             ///< radius of the node above it
  std::vector<TreeNode> nodes;  ///< breadth first
};

/// Returns the strays of a tile's tree, the uppermost first: nodes too small for a sphere code below their parent, and
/// below a parent with gaps (isSpread) all but the largest child. None lies in another, there are at most 64, and they
/// have at most 3072 leaves together.
std::vector<Stray> findStrays(const EditableTree& tree);

/// A place for a stray in a tree.
struct StrayPlace {
  std::uint32_t parent = EditableTree::kNone;             ///< the inner node to add it to
  float radius = std::numeric_limits<float>::infinity();  ///< of a sphere around that node and the stray
};
/// Looks for the smallest node near the stray that is not smaller than it. Nothing in `strays`, which are this tree's,
/// is a place.
StrayPlace findPlace(const EditableTree& tree, std::span<const Stray> strays, const base::Sphere& stray);

/// Plans the moves between the trees of all tiles.
class StrayMoves {
 public:
  /// Reads the nodes of a tile's tree, breadth first; none where the tile has no leaves. Called from several threads.
  using ReadTree = std::function<base::Result<std::vector<TreeNode>>(std::uint32_t tile)>;
  StrayMoves(std::size_t tiles, ReadTree read) : read_(std::move(read)), tiles_(tiles) {}

  /// Reads `threads` trees at a time. The result does not depend on them. Errors: those of reading.
  base::Result<void> plan(unsigned threads);

  /// Whether a tile's tree changes, after plan().
  bool changes(std::uint32_t tile) const { return !tiles_[tile].edits.empty(); }
  /// Returns the nodes of a tile's tree after all moves; none where everything moved out. Errors: those of reading.
  base::Result<std::vector<TreeNode>> nodes(std::uint32_t tile) const;

 private:
  /// Adds a tree below a node, or removes the node where there are none to add.
  struct Edit {
    std::uint32_t node = 0;
    std::vector<TreeNode> added;
  };
  struct Tile {
    base::Sphere root;  ///< radius 0: no leaves
    std::vector<Edit> edits;
    std::vector<Stray> strays;
    bool changed = true;  ///< since its strays were looked for
  };
  struct Choice {
    StrayPlace place;
    std::uint32_t tile = 0;
  };
  using Choices = std::vector<std::vector<Choice>>;  ///< by tile and stray

  base::Result<EditableTree> tree(std::uint32_t tile) const;
  base::Result<void> findAll(unsigned threads);
  base::Result<Choices> choosePlaces(unsigned threads) const;
  bool mayTake(const Tile& tile, const Stray& stray) const;
  bool move(const Choices& choices);

  ReadTree read_;
  std::vector<Tile> tiles_;
};

}  // namespace lod::qsplat::builder
