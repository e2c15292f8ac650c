#pragma once
// Writes a scene's patch hierarchy as 3D Tiles 1.1 (OGC 22-025r4): tileset.json and a GLB for each tile.
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "server/export/surface.h"

namespace server::exports {

struct TilesetOptions {
  bool force = false;  ///< into a directory that is not empty: removes the files of an earlier export
  /// A tree of this many tiles or more, without those in documents below, gets a document of its own. A tile has some
  /// 300 bytes in it.
  std::size_t tiles_per_document = 1000;
};

struct TilesetReport {
  std::uint64_t tiles = 0;
  std::uint64_t documents = 0;  ///< tileset.json, and those that it refers to
  std::uint64_t triangles = 0;  ///< of all tiles
  std::uint64_t bytes = 0;      ///< of all files
};

/// Called with the share of the triangles that is written and the bytes so far; false cancels. One thread at a time.
using ExportProgress = std::function<bool(double done, std::uint64_t bytes)>;

/// Writes into a directory, which is made where it is not there. Files appear whole, tileset.json last. `progress` may
/// be null. Errors: kExists for a directory that is not empty, kCancelled, kNoSpace, kIo, those of a damaged scene;
/// files that are written then stay.
base::Result<TilesetReport> writeTileset(const ExportScene& scene, const std::string& directory,
                                         const TilesetOptions& options, const ExportProgress& progress);

}  // namespace server::exports
