#include "server/export/tile_tree.h"

#include <algorithm>
#include <map>

namespace server::exports {
namespace {

using lod::patch::Group;
using lod::patch::Hierarchy;
using lod::patch::kNoGroup;
using lod::patch::Patch;

// Errors fall by so much at least from a group to the next: some units in the last place of a float, so that viewers
// which compute in float32 see it as well.
constexpr float kLessThanParent = 1.0F - 1e-6F;

class TileTreeBuilder {
 public:
  TileTreeBuilder(const Hierarchy& hierarchy, const std::function<bool(std::uint32_t)>& alone)
      : hierarchy_(hierarchy), alone_(alone), boxes_(hierarchy.groups.size()), tiles_of_(hierarchy.groups.size()) {}

  TileTree build() {
    stateErrors();
    boundGroups();
    addRoot();
    // Parents have smaller numbers, so all tiles of a group are there when its turn comes.
    for (std::uint32_t g = 0; g < hierarchy_.groups.size(); ++g) addTilesBelow(g);
    return std::move(tree_);
  }

 private:
  void stateErrors() {
    tree_.errors.resize(hierarchy_.groups.size());
    tree_.errors[0] = 2.0F * hierarchy_.groups[0].bounds.radius;
    for (std::uint32_t g = 1; g < hierarchy_.groups.size(); ++g) {
      float error = hierarchy_.groups[g].visible_error;
      for (const std::uint32_t parent : hierarchy_.parentsOf(g))
        error = std::min(error, tree_.errors[parent] * kLessThanParent);
      tree_.errors[g] = error;
    }
  }

  // Children have larger numbers, so they come first.
  void boundGroups() {
    for (const Patch& patch : hierarchy_.patches) {
      boxes_[patch.consumer].add(patch.box);
      if (patch.producer != kNoGroup) boxes_[patch.producer].add(patch.box);
    }
    for (std::size_t g = hierarchy_.groups.size(); g-- > 0;) {
      const Group& group = hierarchy_.groups[g];
      for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p)
        if (const std::uint32_t producer = hierarchy_.patches[p].producer; producer != kNoGroup)
          boxes_[g].add(boxes_[producer]);
    }
  }

  // Group 0 produces nothing. Its tile draws nothing and is left out where a single one would be below it.
  void addRoot() {
    if (unitsOf(0).size() > 1) tiles_of_[0].push_back(addTile({0, {}, {}, {}}));
  }

  std::uint32_t addTile(Tile tile) {
    tile.box = tile.group != kNoGroup ? boxes_[tile.group] : boxOf(hierarchy_, tile.patches);
    tree_.tiles.push_back(std::move(tile));
    return static_cast<std::uint32_t>(tree_.tiles.size() - 1);
  }

  // The tiles to come below a group: its consumed patches by their producers.
  std::vector<Tile> unitsOf(std::uint32_t group) const {
    const Group& g = hierarchy_.groups[group];
    std::map<std::uint32_t, Tile> by_producer;
    std::vector<Tile> units;
    for (std::uint32_t p = g.first_patch; p < g.first_patch + g.patch_count; ++p) {
      const std::uint32_t producer = hierarchy_.patches[p].producer;
      if (producer == kNoGroup && alone_(p)) {
        units.push_back({kNoGroup, {p}, {}, {}});
        continue;
      }
      Tile& unit = by_producer[producer];
      unit.group = producer;
      unit.patches.push_back(p);
    }
    for (auto& [producer, unit] : by_producer) units.push_back(std::move(unit));
    return units;
  }

  // Divides the units of most patches until there are enough, or nothing more can be divided.
  static void divide(std::vector<Tile>& units, std::size_t enough) {
    while (units.size() < enough) {
      const auto largest = std::max_element(
          units.begin(), units.end(), [](const Tile& a, const Tile& b) { return a.patches.size() < b.patches.size(); });
      if (largest->patches.size() < 2) return;
      const auto middle = largest->patches.begin() + static_cast<std::ptrdiff_t>(largest->patches.size() / 2);
      Tile half{largest->group, {middle, largest->patches.end()}, {}, {}};
      largest->patches.erase(middle, largest->patches.end());
      units.push_back(std::move(half));
    }
  }

  void addTilesBelow(std::uint32_t group) {
    const std::vector<std::uint32_t> above = tiles_of_[group];
    std::vector<Tile> units = unitsOf(group);
    divide(units, above.size());
    const std::vector<std::size_t> bearer = bearersOf(units, above);
    for (std::size_t u = 0; u < units.size(); ++u) {
      const std::uint32_t producer = units[u].group;
      const std::uint32_t tile = addTile(std::move(units[u]));
      if (producer != kNoGroup) tiles_of_[producer].push_back(tile);
      if (!above.empty()) tree_.tiles[above[bearer[u]]].children.push_back(tile);
    }
    for (const std::uint32_t tile : above) addStandIn(tile);
  }

  void addStandIn(std::uint32_t bearer) {
    const base::Aabb drawn = boxOf(hierarchy_, tree_.tiles[bearer].patches);
    const std::vector<std::uint32_t>& below = tree_.tiles[bearer].children;
    const auto holds = [&](std::uint32_t tile) {
      return tree_.tiles[tile].box.contains(drawn.min) && tree_.tiles[tile].box.contains(drawn.max);
    };
    if (drawn.empty() || std::any_of(below.begin(), below.end(), holds)) return;
    const std::uint32_t stand_in = addTile({});
    tree_.tiles[stand_in].box = drawn;
    tree_.tiles[bearer].children.push_back(stand_in);
  }

  // For each unit the place in `above` of the tile that it hangs under: the nearest, so that a viewer that has loaded
  // some of the tiles shows few gaps; but each tile gets one as long as there are enough.
  std::vector<std::size_t> bearersOf(const std::vector<Tile>& units, const std::vector<std::uint32_t>& above) const {
    std::vector<std::size_t> bearer(units.size(), 0), load(above.size(), 0);
    if (above.size() < 2) return bearer;
    const auto distance = [&](std::size_t unit, std::size_t a) {
      return glm::distance(boxOf(hierarchy_, units[unit].patches).center(),
                           boxOf(hierarchy_, tree_.tiles[above[a]].patches).center());
    };
    for (std::size_t u = 0; u < units.size(); ++u) {
      for (std::size_t a = 1; a < above.size(); ++a)
        if (distance(u, a) < distance(u, bearer[u])) bearer[u] = a;
      ++load[bearer[u]];
    }
    for (std::size_t a = 0; a < above.size(); ++a) {
      if (load[a] > 0) continue;
      std::size_t nearest = units.size();
      for (std::size_t u = 0; u < units.size(); ++u)
        if (load[bearer[u]] > 1 && (nearest == units.size() || distance(u, a) < distance(nearest, a))) nearest = u;
      if (nearest == units.size()) break;
      --load[bearer[nearest]];
      bearer[nearest] = a;
      ++load[a];
    }
    return bearer;
  }

  const Hierarchy& hierarchy_;
  const std::function<bool(std::uint32_t)>& alone_;
  std::vector<base::Aabb> boxes_;                     // per group, of its tiles
  std::vector<std::vector<std::uint32_t>> tiles_of_;  // per group, the tiles that draw what it produced
  TileTree tree_;
};

}  // namespace

TileTree makeTileTree(const Hierarchy& hierarchy, const std::function<bool(std::uint32_t patch)>& alone) {
  return TileTreeBuilder(hierarchy, alone).build();
}

base::Aabb boxOf(const Hierarchy& hierarchy, const std::vector<std::uint32_t>& patches) {
  base::Aabb box;
  for (const std::uint32_t p : patches) box.add(hierarchy.patches[p].box);
  return box;
}

}  // namespace server::exports
