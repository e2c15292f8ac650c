#include "lod/qsplat/builder/strays.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>
#include <queue>
#include <utility>

#include "base/parallel.h"

namespace lod::qsplat::builder {
namespace {

// A tile's strays have at most so many leaves together. A choice: all tiles' strays are in memory, 36 bytes a leaf.
constexpr std::uint64_t kMaxStrayLeaves = 3072;
constexpr std::size_t kMaxStrays = 64;
// A sphere that lies across the steps of its parent's sphere is stored with at least this share of its radius.
constexpr float kLeastShare = 2.0F / kSphereSteps;
// A stray moves where the node above it will be smaller by this factor. A choice: nearer to 1, more would move for
// less.
constexpr float kWorthMoving = 0.5F;
// Strays whose neighbours are strays themselves find their place once those have moved. A choice: later rounds move
// little.
constexpr int kRounds = 3;

double squareOf(float value) {
  return static_cast<double>(value) * static_cast<double>(value);
}

float distanceTo(const base::Sphere& sphere, const glm::vec3& point) {
  return glm::distance(sphere.center, point) - sphere.radius;
}

// Sums over the leaves below a node.
struct Below {
  std::uint64_t leaves = 0;
  double squares = 0.0;  // of their radii
};

// By the place in `order`, which is breadth first.
std::vector<Below> sumBelow(const EditableTree& tree, std::span<const std::uint32_t> order) {
  std::vector<Below> below(order.size());
  std::size_t child = order.size();
  for (std::size_t i = order.size(); i-- > 0;) {
    const std::uint32_t count = tree.children(order[i]).count;
    if (count == 0) below[i] = {1, squareOf(tree.node(order[i]).sphere.radius)};
    for (std::uint32_t c = 0; c < count; ++c) {
      --child;
      below[i].leaves += below[child].leaves;
      below[i].squares += below[child].squares;
    }
  }
  return below;
}

}  // namespace

std::vector<Stray> findStrays(const EditableTree& tree) {
  const std::vector<std::uint32_t> order = tree.order(tree.root());
  const std::vector<Below> below = sumBelow(tree, order);
  std::vector<Stray> found;
  std::vector<bool> inside(order.size(), false);
  std::uint64_t leaves_left = kMaxStrayLeaves;
  std::size_t first = 1;  // place of the node's first child
  for (std::size_t i = 0; i < order.size(); ++i) {
    const float gap = tree.node(order[i]).sphere.radius;
    const std::size_t end = first + tree.children(order[i]).count;
    const bool spread = isSpread(gap, below[i].squares);
    std::size_t largest = first;
    for (std::size_t c = first; c < end; ++c) largest = below[c].leaves > below[largest].leaves ? c : largest;
    for (std::size_t c = first; c < end; ++c) {
      const bool apart = tree.node(order[c]).sphere.radius < kLeastShare * gap || (spread && c != largest);
      inside[c] = inside[i];
      if (inside[c] || !apart || below[c].leaves > leaves_left || found.size() >= kMaxStrays) continue;
      inside[c] = true;
      leaves_left -= below[c].leaves;
      found.push_back({order[c], gap, tree.nodesFrom(order[c])});
    }
    first = end;
  }
  return found;
}

StrayPlace findPlace(const EditableTree& tree, std::span<const Stray> strays, const base::Sphere& stray) {
  // The nearest leaf: of the nodes met so far, the nearest one is opened next.
  struct Met {
    float distance = 0.0F;
    std::uint32_t node = 0;
    bool operator>(const Met& other) const {
      return distance != other.distance ? distance > other.distance : node > other.node;
    }
  };
  std::priority_queue<Met, std::vector<Met>, std::greater<>> met;
  met.push({0.0F, tree.root()});
  std::uint32_t nearest = EditableTree::kNone;
  while (!met.empty() && nearest == EditableTree::kNone) {
    const std::uint32_t at = met.top().node;
    met.pop();
    if (std::any_of(strays.begin(), strays.end(), [at](const Stray& other) { return other.node == at; })) continue;
    if (tree.isLeaf(at)) nearest = at;
    const auto children = tree.children(at);  // its view ends with it
    for (const std::uint32_t child : children.view())
      met.push({distanceTo(tree.node(child).sphere, stray.center), child});
  }
  if (nearest == EditableTree::kNone || nearest == tree.root()) return {};

  std::uint32_t parent = tree.parent(nearest);
  while (parent != tree.root() && tree.node(parent).sphere.radius < stray.radius) parent = tree.parent(parent);
  const std::array<base::Sphere, 2> both{tree.node(parent).sphere, stray};
  return {parent, enclosingSphere(both).radius};
}

// ---- all tiles ----

base::Result<EditableTree> StrayMoves::tree(std::uint32_t tile) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto nodes, read_(tile));
  EditableTree tree(std::move(nodes));
  for (const Edit& edit : tiles_[tile].edits)
    edit.added.empty() ? tree.remove(edit.node) : tree.add(edit.node, edit.added);
  return tree;
}

base::Result<std::vector<TreeNode>> StrayMoves::nodes(std::uint32_t tile) const {
  if (!changes(tile)) return read_(tile);
  LUMIGRID_ASSIGN_OR_RETURN(const auto changed, tree(tile));
  return changed.empty() ? std::vector<TreeNode>() : changed.nodesFrom(changed.root());
}

// Looks for the strays of all tiles that changed.
base::Result<void> StrayMoves::findAll(unsigned threads) {
  return base::tryParallelFor(tiles_.size(), threads, [&](std::size_t i) -> base::Result<void> {
    Tile& tile = tiles_[i];
    if (!std::exchange(tile.changed, false)) return {};
    tile.strays.clear();
    LUMIGRID_ASSIGN_OR_RETURN(const auto found, tree(static_cast<std::uint32_t>(i)));
    tile.root = found.empty() ? base::Sphere() : found.node(found.root()).sphere;
    if (!found.empty()) tile.strays = findStrays(found);
    return {};
  });
}

bool StrayMoves::mayTake(const Tile& tile, const Stray& stray) const {
  return tile.root.radius > 0.0F && distanceTo(tile.root, stray.nodes[0].sphere.center) < kWorthMoving * stray.gap;
}

base::Result<StrayMoves::Choices> StrayMoves::choosePlaces(unsigned threads) const {
  Choices best(tiles_.size());
  for (std::size_t t = 0; t < tiles_.size(); ++t) best[t].resize(tiles_[t].strays.size());
  std::mutex mutex;
  LUMIGRID_TRY(base::tryParallelFor(tiles_.size(), threads, [&](std::size_t i) -> base::Result<void> {
    const auto number = static_cast<std::uint32_t>(i);
    std::optional<EditableTree> here;
    for (std::size_t t = 0; t < tiles_.size(); ++t)
      for (std::size_t s = 0; s < tiles_[t].strays.size(); ++s) {
        const Stray& stray = tiles_[t].strays[s];
        if (!mayTake(tiles_[i], stray)) continue;
        if (!here) {
          LUMIGRID_ASSIGN_OR_RETURN(here, tree(number));
        }
        const StrayPlace place = findPlace(*here, tiles_[i].strays, stray.nodes[0].sphere);
        const std::lock_guard lock(mutex);
        Choice& choice = best[t][s];
        if (place.radius < choice.place.radius || (place.radius == choice.place.radius && number < choice.tile))
          choice = {place, number};
      }
    return {};
  }));
  return best;
}

// Returns whether a stray moves.
bool StrayMoves::move(const Choices& choices) {
  bool moved = false;
  // A node may be a stray's place and lose a child, so strays are added before others are removed.
  for (const bool adding : {true, false})
    for (std::size_t t = 0; t < tiles_.size(); ++t)
      for (std::size_t s = 0; s < tiles_[t].strays.size(); ++s) {
        const Choice& choice = choices[t][s];
        const Stray& stray = tiles_[t].strays[s];
        if (!(choice.place.radius < kWorthMoving * stray.gap)) continue;
        Tile& changed = adding ? tiles_[choice.tile] : tiles_[t];
        changed.edits.push_back(adding ? Edit{choice.place.parent, stray.nodes} : Edit{stray.node, {}});
        moved = changed.changed = true;
      }
  return moved;
}

base::Result<void> StrayMoves::plan(unsigned threads) {
  for (int round = 0; round < kRounds; ++round) {
    LUMIGRID_TRY(findAll(threads));
    LUMIGRID_ASSIGN_OR_RETURN(const auto choices, choosePlaces(threads));
    if (!move(choices)) break;
  }
  for (Tile& tile : tiles_) tile.strays = {};
  return {};
}

}  // namespace lod::qsplat::builder
