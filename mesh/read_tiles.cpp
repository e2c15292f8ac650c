// 3D Tiles 1.0 and 1.1 (OGC 22-025r4): the finest tiles of a tileset as one mesh.
#include <nlohmann/json.hpp>
#include <set>

#include "base/file.h"
#include "mesh/gltf/instances.h"
#include "mesh/readers.h"
#include "mesh/tiles/content.h"
#include "mesh/tiles/tile_tree.h"

namespace mesh {
namespace {

std::string describe(const std::map<std::string, std::uint64_t>& left_out) {
  std::string line;
  for (const auto& [kind, count] : left_out) line += (line.empty() ? "" : ", ") + std::to_string(count) + " " + kind;
  return line;
}

/// Tiles may show one file again and again, as a document's nodes may show a mesh.
class TimesShown {
 public:
  /// To be called after each tile.
  base::Result<void> check(const std::string& path, const gltf::Omissions& omissions, const MeshStream& out) {
    // Every point is in its file; triangles may be there several times.
    const std::uint64_t held = out.reads_points ? out.vertexCount() : omissions.triangles_in_meshes;
    const std::uint64_t in_tile = held - before_;
    before_ = held;
    if (files_.insert(path).second) held_ += static_cast<double>(in_tile);
    if (out.reads_points) return gltf::checkTimesShown({0.0, static_cast<double>(held)}, {0.0, held_});
    return gltf::checkTimesShown({static_cast<double>(omissions.triangles), 0.0}, {held_, 0.0});
  }

 private:
  std::set<std::string> files_;
  std::uint64_t before_ = 0;  // of all tiles so far
  double held_ = 0.0;         // triangles or points of all files so far
};

base::Result<void> readTile(const tiles::TileContent& content, const gltf::ShareOfSource& share,
                            gltf::Omissions& omissions, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(content.path));
  return tiles::readContent(file.bytes(), content.path, content.world_from_tile, content.up, share, omissions, out);
}

base::Result<void> readTiles(const tiles::TileTree& tree, gltf::Omissions& omissions, MeshStream& out) {
  TimesShown times_shown;
  const auto count = static_cast<double>(tree.contents.size());
  for (std::size_t i = 0; i < tree.contents.size(); ++i) {
    const gltf::ShareOfSource share{static_cast<double>(i) / count, static_cast<double>(i + 1) / count};
    if (auto read = readTile(tree.contents[i], share, omissions, out); !read) {
      const bool named = read.error().code == base::ErrorCode::kCancelled ||
                         read.error().code == base::ErrorCode::kIo || read.error().code == base::ErrorCode::kNoSpace ||
                         read.error().message.rfind(tree.contents[i].path, 0) == 0;
      return named ? read.error() : base::within(tree.contents[i].path, read.error());
    }
    LUMIGRID_TRY(times_shown.check(tree.contents[i].path, omissions, out));
    LUMIGRID_TRY(out.report(share.end));
  }
  return {};
}

}  // namespace

base::Result<void> readTileset(const nlohmann::json& tileset, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(auto tree, tiles::expandTileset(tileset, out.textures.path(), false));
  gltf::Omissions omissions;
  LUMIGRID_TRY(readTiles(tree, omissions, out));
  const bool has_points = tree.has_points || omissions.point_primitives > 0;
  if (out.triangleCount() == 0 && has_points) {
    LUMIGRID_TRY(beginPoints(out));
    LUMIGRID_ASSIGN_OR_RETURN(tree, tiles::expandTileset(tileset, out.textures.path(), true));
    omissions = {};
    LUMIGRID_TRY(readTiles(tree, omissions, out));
    if (out.vertexCount() == 0) return invalidInput("its tiles have no points");
  }
  const std::string left_out = describe(tree.left_out);
  if (tree.contents.empty())
    return left_out.empty() ? invalidInput("the tileset has no content")
                            : unsupported("none of its tiles can be read; there are " + left_out);
  if (out.triangleCount() == 0 && !out.reads_points) return invalidInput("its tiles have no triangles");
  omissions.describe(out.summary.warnings);
  if (!left_out.empty()) out.summary.warnings.push_back("it is read without tiles that are not read: " + left_out);
  // Lengths are in metres, and z is up unless coordinates are the whole earth's.
  out.summary.georeference.units = "m";
  if (tree.is_geocentric)
    out.summary.georeference.crs = "EPSG:4978";
  else
    out.summary.georeference.up = Georeference::Up::kZ;
  return out.handOver();
}

base::Result<void> readTile(base::ByteView bytes, MeshStream& out) {
  const auto read = [&]() -> base::Result<gltf::Omissions> {
    gltf::Omissions omissions;
    LUMIGRID_TRY(
        tiles::readContent(bytes, out.textures.path(), glm::dmat4(1.0), tiles::UpAxis::kY, {}, omissions, out));
    return omissions;
  };
  LUMIGRID_ASSIGN_OR_RETURN(gltf::Omissions omissions, read());
  if (out.triangleCount() == 0 && omissions.point_primitives > 0) {
    LUMIGRID_TRY(beginPoints(out));
    LUMIGRID_ASSIGN_OR_RETURN(omissions, read());
    if (out.vertexCount() == 0) return invalidInput("the file has no points");
  } else if (out.triangleCount() == 0) {
    return invalidInput("the file has no triangles");
  }
  omissions.describe(out.summary.warnings);
  return out.handOver();
}

}  // namespace mesh
