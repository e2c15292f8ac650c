#pragma once
// The tree of tiles of a tileset and of those that it names, without opening more of the contents than their begin.
#include <glm/glm.hpp>
#include <map>
#include <string>
#include <vector>

#include "base/error.h"
#include "mesh/gltf/json_values.h"
#include "mesh/tiles/content.h"

namespace mesh::tiles {

/// A content of the finest tiles.
struct TileContent {
  std::string path;
  glm::dmat4 world_from_tile{1.0};
  UpAxis up = UpAxis::kY;
};

struct TileTree {
  std::vector<TileContent> contents;
  std::map<std::string, std::uint64_t> left_out;  ///< how many contents of each kind that is not read
  bool has_points = false;                        ///< some contents are points (pnts)
  bool is_geocentric = false;                     ///< its coordinates are of the whole earth (EPSG:4978)
};

/// Whether the JSON is a tileset.
bool isTileset(const gltf::json& parsed);

/// Finds the finest contents of the tileset that has been read from `path`; point tiles only if `with_points`. Errors
/// name other files.
base::Result<TileTree> expandTileset(const gltf::json& tileset, const std::string& path, bool with_points);

}  // namespace mesh::tiles
