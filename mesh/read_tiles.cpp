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
  base::Result<void> check(const std::string& path, const gltf::Omissions& omissions) {
    const std::uint64_t in_tile = omissions.triangles_in_meshes - in_meshes_;
    in_meshes_ = omissions.triangles_in_meshes;
    if (files_.insert(path).second) held_ += static_cast<double>(in_tile);
    return gltf::checkTimesShown({static_cast<double>(omissions.triangles), 0.0}, {held_, 0.0});
  }

 private:
  std::set<std::string> files_;
  std::uint64_t in_meshes_ = 0;  // of all tiles so far
  double held_ = 0.0;            // triangles of all files so far
};

base::Result<void> readTile(const tiles::TileContent& content, const gltf::ShareOfSource& share,
                            gltf::Omissions& omissions, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(content.path));
  return tiles::readContent(file.bytes(), content.path, content.world_from_tile, content.up, share, omissions, out);
}

}  // namespace

base::Result<void> readTileset(const nlohmann::json& tileset, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto tree, tiles::expandTileset(tileset, out.textures.path()));
  const std::string left_out = describe(tree.left_out);
  if (tree.contents.empty())
    return left_out.empty() ? invalidInput("the tileset has no content")
                            : unsupported("none of its tiles can be read; there are " + left_out);
  gltf::Omissions omissions;
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
    LUMIGRID_TRY(times_shown.check(tree.contents[i].path, omissions));
    LUMIGRID_TRY(out.report(share.end));
  }
  if (out.triangleCount() == 0) return invalidInput("its tiles have no triangles");
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
  gltf::Omissions omissions;
  LUMIGRID_TRY(tiles::readContent(bytes, out.textures.path(), glm::dmat4(1.0), tiles::UpAxis::kY, {}, omissions, out));
  if (out.triangleCount() == 0) return invalidInput("the file has no triangles");
  omissions.describe(out.summary.warnings);
  return out.handOver();
}

}  // namespace mesh
