#pragma once
// Implicit tiling: tiles that no JSON lists, but the bits of subtree files. Section names in the source refer to the
// specification 3D Tiles 1.1 (OGC 22-025r4); the extension 3DTILES_implicit_tiling of version 1.0 is read, too.
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"
#include "mesh/gltf/json_values.h"

namespace mesh::tiles {

/// Whether a tile of a tileset stands for a whole implicit tree.
bool isImplicit(const gltf::json& tile);

struct ImplicitTiling {
  unsigned children = 4;          ///< of a tile: 4 of a quadtree, 8 of an octree
  unsigned subtree_levels = 1;    ///< of tiles in a subtree file, 1 … 20
  unsigned available_levels = 1;  ///< of the whole tree, 1 … 62
  std::string subtrees;           ///< template of the subtrees' names

  /// The tiling of a tile that isImplicit(). Errors: kInvalidInput, kUnsupported.
  static base::Result<ImplicitTiling> of(const gltf::json& tile);
};

/// A tile's place in the whole implicit tree: x, y and (in octrees) z are below 2^level.
struct TileCoordinates {
  unsigned level = 0;
  std::array<std::uint64_t, 3> at{};

  /// Child c of 0 … 3 or 0 … 7, in Morton order: its lowest bit is x's.
  TileCoordinates child(unsigned c) const;
};

/// Puts the coordinates into a template (section "Template URIs"): "{level}/{x}/{y}.glb".
std::string nameFromTemplate(std::string_view text, const TileCoordinates& tile);
/// Whether a template names each tile's own file. A hostile tree of a few bytes could have millions of tiles otherwise.
bool tellsTilesApart(const std::string& text, const ImplicitTiling& tiling);

/// The availability of the tiles of a subtree (section "Subtrees"). Tiles are named by their level in the subtree and
/// by their Morton index in that level.
class Subtree {
 public:
  /// Errors name the file: those of opening, kInvalidInput, kUnsupported.
  static base::Result<Subtree> open(const std::string& path, const ImplicitTiling& tiling);
  /// The same of bytes that outlive it. Errors do not name `path`, beside which outside buffers lie.
  static base::Result<Subtree> parse(base::ByteView bytes, const std::string& path, const ImplicitTiling& tiling);

  /// `level` < tiling.subtree_levels, `morton` < children^level.
  bool hasTile(unsigned level, std::uint64_t morton) const { return tiles_.has(tileBit(level, morton)); }
  /// False for contents that the file does not tell of.
  bool hasContent(std::size_t content, unsigned level, std::uint64_t morton) const {
    return content < contents_.size() && contents_[content].has(tileBit(level, morton));
  }
  /// `morton` < children^subtree_levels.
  bool hasChildSubtree(std::uint64_t morton) const { return subtrees_.has(morton); }

 private:
  /// A bit each, or one for all (section "Availability").
  struct Availability {
    base::ByteView bits;
    bool all = false;
    bool has(std::uint64_t bit) const { return bits.empty() ? all : (bits[bit / 8] >> (bit % 8) & 1U) != 0; }
  };
  std::uint64_t tileBit(unsigned level, std::uint64_t morton) const;
  base::Result<Availability> availability(const gltf::json& source, const std::string& what, std::uint64_t bits);
  base::Result<base::ByteView> buffer(std::uint64_t index);

  ImplicitTiling tiling_;
  std::string path_;
  gltf::json root_;
  base::ByteView binary_;
  base::MappedFile file_;
  std::vector<base::MappedFile> outside_;
  Availability tiles_, subtrees_;
  std::vector<Availability> contents_;
};

}  // namespace mesh::tiles
