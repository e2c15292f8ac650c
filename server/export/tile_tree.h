#pragma once
// Maps a patch hierarchy, whose groups form a directed acyclic graph, to a tree of tiles whose refinement draws the
// same cuts (docs/decisions/export-3dtiles.md).
//
// A tile stands for an edge of that graph: it draws the patches that one group produced and one of its parents
// consumes. All tiles of a group have the same error and the same box, so a viewer that decides by these refines all of
// them or none, which is to expand the group. The tiles below a group hang under any of its tiles.
#include <cstdint>
#include <functional>
#include <vector>

#include "lod/patch/hierarchy.h"

namespace server::exports {

struct Tile {
  /// The group that produced its patches, whose error the tile has: it is refined when this group is expanded.
  /// kNoGroup: the tile draws leaves or nothing, and is never refined.
  std::uint32_t group = lod::patch::kNoGroup;
  std::vector<std::uint32_t> patches;   ///< to draw; none in a root above several, or in a stand-in
  std::vector<std::uint32_t> children;  ///< numbers of tiles, all larger than its own
  base::Aabb box;  ///< holds all that the group is made of and produced; equal for all tiles of a group
};

struct TileTree {
  std::vector<Tile> tiles;  ///< tile 0 is the root; each box contains those of the tiles below
  /// Per group, scene units: its visible error, or slightly less where a parent's is no larger, since viewers refine a
  /// tile at once that has not less error than the tile above it. Group 0 has twice its sphere's radius.
  std::vector<float> errors;
};

/// `alone(p)` says that the leaf patch p has a tile of its own; other leaves that one group consumes share one. Each
/// patch is in one tile.
///
/// A viewer may pass over a tile where none of the tiles below is in view. Where these do not contain all that a tile
/// draws, one more hangs there that draws nothing, the stand-in, whose box does. So each tile with a group has tiles
/// below, too.
TileTree makeTileTree(const lod::patch::Hierarchy& hierarchy, const std::function<bool(std::uint32_t patch)>& alone);

/// Holds the boxes of these patches; `patches` is not empty.
base::Aabb boxOf(const lod::patch::Hierarchy& hierarchy, const std::vector<std::uint32_t>& patches);

}  // namespace server::exports
