// The tree of tiles, walked as viewers walk it, draws the cuts of the hierarchy.
#include "server/export/tile_tree.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "lod/patch/traverse.h"
#include "tests/server/export/export_testing.h"
#include "tests/support/synthetic_hierarchy.h"
#include "tests/support/temporary_directory.h"

namespace {

using lod::patch::Hierarchy;
using lod::patch::kNoGroup;
using server::exports::makeTileTree;
using server::exports::Tile;
using server::exports::TileTree;

bool never(std::uint32_t) {
  return false;
}

/// Decides by error and box alone, as viewers do.
using Refine = std::function<bool(float error, const base::Aabb& box)>;

/// The patches of the tiles at which a walk of REPLACE refinement ends.
std::multiset<std::uint32_t> drawnBy(const TileTree& tree, const Refine& refine) {
  std::multiset<std::uint32_t> drawn;
  std::vector<std::uint32_t> open{0};
  while (!open.empty()) {
    const Tile& tile = tree.tiles[open.back()];
    open.pop_back();
    if (!tile.children.empty() && refine(tree.errors[tile.group], tile.box))
      open.insert(open.end(), tile.children.begin(), tile.children.end());
    else
      drawn.insert(tile.patches.begin(), tile.patches.end());
  }
  return drawn;
}

/// The same decisions on the graph of groups.
std::multiset<std::uint32_t> cutBy(const Hierarchy& hierarchy, const TileTree& tree, const Refine& refine) {
  std::vector<base::Aabb> boxes(hierarchy.groups.size());
  for (const Tile& tile : tree.tiles)
    if (tile.group != kNoGroup) boxes[tile.group] = tile.box;
  std::vector<std::uint8_t> expanded(hierarchy.groups.size());
  for (std::uint32_t g = 0; g < expanded.size(); ++g) {
    expanded[g] = g == 0 || refine(tree.errors[g], boxes[g]);
    for (const std::uint32_t parent : hierarchy.parentsOf(g)) expanded[g] &= expanded[parent];
  }
  const auto cut = lod::patch::cutOfExpanded(hierarchy, expanded);
  return {cut.patches.begin(), cut.patches.end()};
}

/// A viewer somewhere around the model that refines above some error.
Refine randomViewer(const Hierarchy& hierarchy, std::mt19937& random) {
  const base::Sphere whole = hierarchy.groups[0].bounds;
  std::uniform_real_distribution<float> share(-2.0F, 2.0F), exponent(-12.0F, 0.0F);
  const glm::vec3 eye = whole.center + whole.radius * glm::vec3(share(random), share(random), share(random));
  const float tolerance = std::exp2(exponent(random));
  return [eye, tolerance](float error, const base::Aabb& box) {
    const glm::vec3 outside = glm::max(glm::max(box.min - eye, eye - box.max), glm::vec3(0.0F));
    return error > tolerance * std::max(glm::length(outside), 1e-6F);
  };
}

void expectTreeOfCuts(const Hierarchy& hierarchy, const TileTree& tree) {
  std::mt19937 random(7);
  std::set<std::multiset<std::uint32_t>> cuts;
  for (int i = 0; i < 300; ++i) {
    const Refine viewer = randomViewer(hierarchy, random);
    const auto drawn = drawnBy(tree, viewer);
    ASSERT_EQ(drawn, cutBy(hierarchy, tree, viewer));
    cuts.insert(drawn);
  }
  EXPECT_GT(cuts.size(), 5U) << "the viewers should see different cuts";
}

TEST(TileTree, drawsTheCutsOfAHierarchyWhoseGroupsHaveSeveralParents) {
  for (const int n : {4, 8, 16}) {
    const Hierarchy hierarchy = support::syntheticHierarchy(n).hierarchy;
    expectTreeOfCuts(hierarchy, makeTileTree(hierarchy, never));
  }
}

TEST(TileTree, drawsTheCutsOfABuiltHierarchy) {
  const support::TemporaryDirectory directory;
  const auto scene = export_testing::exportScene(support::torus(150, 80), directory / "patch.lgp");
  const Hierarchy& hierarchy = scene.hierarchy();
  ASSERT_GT(hierarchy.groups.size(), 10U);
  ASSERT_GT(hierarchy.parents.size(), hierarchy.groups.size()) << "some groups should have several parents";
  expectTreeOfCuts(hierarchy, makeTileTree(hierarchy, never));
  expectTreeOfCuts(hierarchy, makeTileTree(hierarchy, [](std::uint32_t patch) { return patch % 2 == 0; }));
}

TEST(TileTree, hasEachPatchInOneTileAndEachTileOnce) {
  const Hierarchy hierarchy = support::syntheticHierarchy(8).hierarchy;
  const TileTree tree = makeTileTree(hierarchy, never);
  std::vector<int> drawn(hierarchy.patches.size(), 0), above(tree.tiles.size(), 0);
  for (std::uint32_t t = 0; t < tree.tiles.size(); ++t) {
    for (const std::uint32_t p : tree.tiles[t].patches) {
      ++drawn[p];
      EXPECT_EQ(hierarchy.patches[p].producer, tree.tiles[t].group);
    }
    for (const std::uint32_t child : tree.tiles[t].children) {
      EXPECT_GT(child, t);
      ++above[child];
    }
  }
  EXPECT_EQ(drawn, std::vector<int>(hierarchy.patches.size(), 1));
  EXPECT_EQ(above[0], 0);
  EXPECT_EQ(std::count(above.begin() + 1, above.end(), 1), static_cast<std::ptrdiff_t>(above.size() - 1));
}

TEST(TileTree, hasBoxesThatContainThoseBelow) {
  const Hierarchy hierarchy = support::syntheticHierarchy(8).hierarchy;
  const TileTree tree = makeTileTree(hierarchy, never);
  std::map<std::uint32_t, base::Aabb> boxes;
  const auto contains = [](const base::Aabb& outer, const base::Aabb& inner) {
    return outer.contains(inner.min) && outer.contains(inner.max);
  };
  for (const Tile& tile : tree.tiles) {
    const base::Aabb drawn = server::exports::boxOf(hierarchy, tile.patches);
    EXPECT_TRUE(drawn.empty() || contains(tile.box, drawn));
    for (const std::uint32_t child : tile.children) EXPECT_TRUE(contains(tile.box, tree.tiles[child].box));
    if (tile.group == kNoGroup) continue;
    const auto [first, is_new] = boxes.try_emplace(tile.group, tile.box);
    EXPECT_TRUE(is_new || (first->second.min == tile.box.min && first->second.max == tile.box.max));
  }
}

// Viewers leave a tile out where none of those below is in view, which must not lose anything that it draws.
TEST(TileTree, hasOneBelowEachTileThatHoldsAllThatItDraws) {
  const Hierarchy hierarchy = support::syntheticHierarchy(16).hierarchy;
  const TileTree tree = makeTileTree(hierarchy, never);
  for (const Tile& tile : tree.tiles) {
    if (tile.group == kNoGroup || tile.patches.empty()) continue;
    const base::Aabb drawn = server::exports::boxOf(hierarchy, tile.patches);
    EXPECT_TRUE(std::any_of(tile.children.begin(), tile.children.end(), [&](std::uint32_t child) {
      return tree.tiles[child].box.contains(drawn.min) && tree.tiles[child].box.contains(drawn.max);
    }));
  }
}

TEST(TileTree, givesEachTileLessErrorThanTheOneAbove) {
  // Levels that add no error of their own state that of the level below.
  Hierarchy hierarchy = support::syntheticHierarchy(8).hierarchy;
  for (std::size_t g = 1; g < hierarchy.groups.size(); ++g) hierarchy.groups[g].visible_error = 0.25F;
  const TileTree tree = makeTileTree(hierarchy, never);
  for (const Tile& tile : tree.tiles)
    for (const std::uint32_t child : tile.children)
      if (const std::uint32_t below = tree.tiles[child].group; below != kNoGroup) {
        EXPECT_LT(tree.errors[below], tree.errors[tile.group]);
      }
  for (std::size_t g = 1; g < hierarchy.groups.size(); ++g) EXPECT_NEAR(tree.errors[g], 0.25F, 1e-5F);
}

// Groups 1 and 2 each consume a patch of group 3, so there are two tiles of it, but it consumes a single leaf:
//
//   group 0 consumes patch 0 of group 1 and patch 1 of group 2
//   group 1 consumes patch 2 of group 3
//   group 2 consumes patch 3 of group 3
//   group 3 consumes leaf 4
TEST(TileTree, hangsAnEmptyTileUnderOneThatWouldHaveNoneBelow) {
  Hierarchy h;
  h.groups.resize(4);
  h.patches.resize(5);
  const std::array<std::uint32_t, 5> producer{1, 2, 3, 3, kNoGroup};
  const std::array<std::uint32_t, 4> first{0, 2, 3, 4}, count{2, 1, 1, 1};
  for (std::uint32_t p = 0; p < 5; ++p) {
    h.patches[p].producer = producer[p];
    h.patches[p].box.add(glm::vec3(static_cast<float>(p)));
  }
  h.parents = {0, 0, 1, 2};
  for (std::uint32_t g = 0; g < 4; ++g) {
    h.groups[g].first_patch = first[g];
    h.groups[g].patch_count = count[g];
    h.groups[g].visible_error = 8.0F / static_cast<float>(g + 1);
    h.groups[g].bounds.radius = 10.0F;
    h.groups[g].first_parent = g == 0 ? 0 : g - 1;
    h.groups[g].parent_count = g == 0 ? 0 : g == 3 ? 2 : 1;
  }
  const TileTree tree = makeTileTree(h, never);
  std::size_t stand_ins = 0;
  for (const Tile& tile : tree.tiles) {
    EXPECT_EQ(tile.children.empty(), tile.group == kNoGroup);
    if (tile.group == kNoGroup && tile.patches.empty()) ++stand_ins;
  }
  EXPECT_EQ(stand_ins, 4U) << "each box here is a point, which no other contains";
  const auto all = drawnBy(tree, [](float, const base::Aabb&) { return true; });
  EXPECT_EQ(all, (std::multiset<std::uint32_t>{4}));
}

}  // namespace
