#include "mesh/tiles/tile_tree.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "base/file.h"
#include "mesh/mesh_stream.h"
#include "mesh/tiles/subtree.h"
#include "mesh/uri.h"

namespace mesh::tiles {
namespace {

using gltf::extension;
using gltf::item;
using gltf::itemsOf;
using gltf::json;
using gltf::member;
using gltf::numbers;

// Each level halves a tile, so that real trees have less than 40. Tilesets may name one another, and a small hostile
// one must not keep us busy for ever.
constexpr int kMaxDepth = 512;
constexpr std::uint64_t kMaxTiles = std::uint64_t{1} << 24;

constexpr const char* kRemote = "at other hosts";

/// The state that a tile inherits from the one above it.
struct Above {
  glm::dmat4 world_from_tile{1.0};
  bool adds = false;  // its refinement adds to it, and does not replace it
  int depth = 0;
};

/// A tileset that is being walked through.
struct OpenTileset {
  std::string path;
  UpAxis up = UpAxis::kY;
};

UpAxis upAxisOf(const json& tileset) {
  // Tilesets of before version 1.0 say so; many still do.
  const std::string axis = gltf::text(member(member(tileset, "asset"), "gltfUpAxis"));
  return axis == "Z" || axis == "z" ? UpAxis::kZ : axis == "X" || axis == "x" ? UpAxis::kX : UpAxis::kY;
}

/// An implicit tree that is being walked through.
struct OpenTree {
  const OpenTileset& in;
  const Above& above;  // of all its tiles
  ImplicitTiling tiling;
  std::vector<std::string> contents;  // templates of their names
};

/// A tile within the subtree file that tells of it.
struct TileInSubtree {
  const Subtree& subtree;
  unsigned level = 0;
  std::uint64_t morton = 0;
};

std::vector<const json*> contentsOf(const json& tile) {
  std::vector<const json*> contents;
  if (const json& one = member(tile, "content"); one.is_object()) contents.push_back(&one);
  const json& several = extension(tile, "3DTILES_multiple_contents");
  for (const json* list : {&member(tile, "contents"), &member(several, "contents"), &member(several, "content")})
    for (std::size_t i = 0; i < itemsOf(*list); ++i) contents.push_back(&(*list)[i]);
  return contents;
}

std::string referenceOf(const json& content) {
  // Before version 1.0 the member was called "url".
  const json& uri = member(content, "uri");
  return gltf::text(uri.is_null() ? member(content, "url") : uri);
}

// Whether a box's or a sphere's middle lies where the earth's surface is, in metres from its middle.
bool isNearEarthsSurface(const json& volume, const glm::dmat4& world_from_tile) {
  const json* numbers = &member(volume, "box");
  if (!numbers->is_array()) numbers = &member(volume, "sphere");
  glm::dvec4 middle(0.0, 0.0, 0.0, 1.0);
  for (int k = 0; k < 3; ++k) middle[k] = gltf::number(item(*numbers, static_cast<std::uint64_t>(k)), 0.0);
  constexpr double kLeast = 6.33e6, kMost = 6.40e6;  // the deepest sea at a pole, and the highest mountain
  const glm::dvec3 world(world_from_tile * middle);
  const double distance = glm::length(world);
  // Eastings and northings of maps may be as long, with a height for z; here z is small at the equator alone.
  constexpr double kHeights = 1e4;
  return distance > kLeast && distance < kMost && std::abs(world.z) > kHeights;
}

class TileWalk {
 public:
  TileWalk(TileTree& tree, bool with_points) : tree_(tree), with_points_(with_points) {}

  base::Result<void> tileset(const json& parsed, const std::string& path, const Above& above) {
    std::error_code ignored;
    const std::string whole = std::filesystem::weakly_canonical(path, ignored).string();
    if (!open_.insert(whole).second) return invalidInput("a tileset names itself: " + path);
    const OpenTileset here{path, upAxisOf(parsed)};
    LUMIGRID_TRY(tile(member(parsed, "root"), here, above));
    open_.erase(whole);
    return {};
  }

 private:
  // Contents of tiles below come first, since they may replace this tile's.
  base::Result<void> tile(const json& tile, const OpenTileset& in, const Above& above) {
    if (above.depth > kMaxDepth)
      return unsupported("its tiles are nested more than " + std::to_string(kMaxDepth) + " deep");
    LUMIGRID_TRY(countTile());
    Above here = above;
    ++here.depth;
    if (const json& matrix = member(tile, "transform"); !matrix.is_null()) {
      const auto parent_from_tile = numbers<glm::dmat4>(matrix);
      if (!parent_from_tile) return invalidInput("the transform of a tile is not 16 numbers");
      here.world_from_tile = above.world_from_tile * *parent_from_tile;
    }
    if (const std::string refine = gltf::text(member(tile, "refine")); !refine.empty())
      here.adds = refine[0] == 'A' || refine[0] == 'a';
    const json& volume = member(tile, "boundingVolume");
    tree_.is_geocentric |= member(volume, "region").is_array() || isNearEarthsSurface(volume, here.world_from_tile);

    const std::size_t before = tree_.contents.size();
    const json& children = member(tile, "children");
    for (std::size_t c = 0; c < itemsOf(children); ++c) LUMIGRID_TRY(this->tile(children[c], in, here));
    const bool replaced = !here.adds && tree_.contents.size() > before;
    if (replaced) return {};
    if (isImplicit(tile)) return implicitTree(tile, in, here);
    for (const json* content : contentsOf(tile)) LUMIGRID_TRY(addContent(referenceOf(*content), in, here));
    return {};
  }

  base::Result<void> implicitTree(const json& root, const OpenTileset& in, const Above& above) {
    OpenTree tree{in, above, {}, {}};
    LUMIGRID_ASSIGN_OR_RETURN(tree.tiling, ImplicitTiling::of(root));
    for (const json* content : contentsOf(root)) tree.contents.push_back(referenceOf(*content));
    for (const std::string& text : tree.contents)
      if (!tellsTilesApart(text, tree.tiling)) return sameNames(text);
    if (!tellsTilesApart(tree.tiling.subtrees, tree.tiling)) return sameNames(tree.tiling.subtrees);
    return subtree(tree, {});
  }

  static base::Error sameNames(const std::string& text) {
    return invalidInput("implicit tiling gives several tiles one name: " + inQuotes(text));
  }

  base::Result<void> subtree(const OpenTree& tree, const TileCoordinates& root) {
    LUMIGRID_TRY(countTile());
    const std::string path = fileOfReference(tree.in.path, nameFromTemplate(tree.tiling.subtrees, root));
    LUMIGRID_ASSIGN_OR_RETURN(const Subtree subtree, Subtree::open(path, tree.tiling));
    return implicitTile(tree, {subtree, 0, 0}, root);
  }

  // As tile(), for one that bits tell of.
  base::Result<void> implicitTile(const OpenTree& tree, const TileInSubtree& in, const TileCoordinates& tile) {
    if (!in.subtree.hasTile(in.level, in.morton)) return {};
    LUMIGRID_TRY(countTile());
    const std::size_t before = tree_.contents.size();
    const bool has_children = tile.level + 1 < tree.tiling.available_levels;
    for (unsigned c = 0; has_children && c < tree.tiling.children; ++c) {
      const TileInSubtree child{in.subtree, in.level + 1, tree.tiling.children * in.morton + c};
      if (child.level < tree.tiling.subtree_levels)
        LUMIGRID_TRY(implicitTile(tree, child, tile.child(c)));
      else if (in.subtree.hasChildSubtree(child.morton))
        LUMIGRID_TRY(subtree(tree, tile.child(c)));
    }
    if (!tree.above.adds && tree_.contents.size() > before) return {};
    Above here = tree.above;
    here.depth += static_cast<int>(tile.level);
    for (std::size_t c = 0; c < tree.contents.size(); ++c)
      if (in.subtree.hasContent(c, in.level, in.morton))
        LUMIGRID_TRY(addContent(nameFromTemplate(tree.contents[c], tile), tree.in, here));
    return {};
  }

  base::Result<void> countTile() {
    if (++tiles_ > kMaxTiles) return unsupported("it has more than " + std::to_string(kMaxTiles) + " tiles");
    return {};
  }

  base::Result<void> addContent(const std::string& reference, const OpenTileset& in, const Above& here) {
    if (reference.empty()) return invalidInput("a content has no uri");
    if (isRemote(reference) || isDataUri(reference)) {
      ++tree_.left_out[kRemote];
      return {};
    }
    const std::string path = fileOfReference(in.path, reference);
    LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::PositionedFile::open(path));
    base::Bytes begin(static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), 64)));
    LUMIGRID_TRY(file.readAt(0, begin));
    switch (kindOf(begin)) {
      case ContentKind::kGlb:
      case ContentKind::kBatchedModel:
        tree_.contents.push_back({path, here.world_from_tile, in.up});
        return {};
      case ContentKind::kJson:
        return addJson(path, in, here);
      case ContentKind::kInstancedModels:
        ++tree_.left_out["of instanced models (i3dm)"];
        return {};
      case ContentKind::kPoints:
        tree_.has_points = true;
        if (with_points_)
          tree_.contents.push_back({path, here.world_from_tile, in.up});
        else
          ++tree_.left_out["of points (pnts)"];
        return {};
      case ContentKind::kComposite:
        ++tree_.left_out["of several formats in one (cmpt)"];
        return {};
      case ContentKind::kGzip:
        return unsupported(path + ": it is compressed by gzip, which is not read; unpack the tiles first: gunzip");
      default:
        return unsupported(path + ": its content is of no kind that 3D Tiles know (" +
                           (begin.empty() ? "it is empty" : "truncated?") + ")");
    }
  }

  base::Result<void> addJson(const std::string& path, const OpenTileset& in, const Above& here) {
    json parsed;
    {
      LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(path));
      parsed = json::parse(file.bytes().begin(), file.bytes().end(), nullptr, false);
    }
    if (!parsed.is_object()) return invalidInput(path + ": the JSON is broken (truncated?)");
    if (isTileset(parsed)) return tileset(parsed, path, here);
    tree_.contents.push_back({path, here.world_from_tile, in.up});
    return {};
  }

  TileTree& tree_;
  const bool with_points_;
  std::set<std::string> open_;  // tilesets that the current tile lies in
  std::uint64_t tiles_ = 0;
};

}  // namespace

bool isTileset(const json& parsed) {
  return member(parsed, "root").is_object();
}

base::Result<TileTree> expandTileset(const json& tileset, const std::string& path, bool with_points) {
  TileTree tree;
  LUMIGRID_TRY(TileWalk(tree, with_points).tileset(tileset, path, {}));
  return tree;
}

}  // namespace mesh::tiles
