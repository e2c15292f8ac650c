#include "server/export/tileset.h"

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <system_error>

#include "base/file.h"
#include "base/parallel.h"
#include "server/export/tile_tree.h"

namespace server::exports {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using lod::patch::kNoGroup;
using nlohmann::json;

constexpr const char* kDocument = "tileset.json";
constexpr std::uint32_t kFilesPerFolder = 1000;

// ---- The place

bool isNumber(const std::string& text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
}

/// Whether a path is one that only an export gives: tileset.json, tileset-12.json, 3/3017.glb, or what a killed one
/// left of such a file.
bool isExported(const std::filesystem::path& relative) {
  std::string name = relative.filename().string();
  const std::size_t part = name.rfind(".part");
  if (part != std::string::npos && base::isUnfinished(name, name.substr(0, part))) name.resize(part);
  if (relative.has_parent_path())
    return isNumber(relative.parent_path().string()) && name.ends_with(".glb") &&
           isNumber(name.substr(0, name.size() - 4));
  return name == kDocument ||
         (name.starts_with("tileset-") && name.ends_with(".json") && isNumber(name.substr(8, name.size() - 13)));
}

Error fileError(const std::string& directory, const std::error_code& code) {
  return {ErrorCode::kIo, directory + ": " + code.message()};
}

Result<void> removeEarlierExport(const std::string& directory) {
  std::error_code code;
  // A tileset whose tiles are being replaced must not be read.
  std::filesystem::remove(std::filesystem::path(directory) / kDocument, code);
  std::vector<std::filesystem::path> found;
  for (std::filesystem::recursive_directory_iterator at(directory, code), end; !code && at != end; at.increment(code)) {
    if (at.depth() > 0) at.disable_recursion_pending();
    std::error_code unreadable;
    if (at->is_regular_file(unreadable) && isExported(std::filesystem::relative(at->path(), directory, unreadable)))
      found.push_back(at->path());
  }
  for (const std::filesystem::path& path : found)
    if (!code) std::filesystem::remove(path, code);
  return code ? fileError(directory, code) : Result<void>();
}

Result<void> prepareDirectory(const std::string& directory, bool force) {
  std::error_code code;
  if (std::filesystem::exists(directory, code) && !std::filesystem::is_directory(directory, code))
    return Error{ErrorCode::kExists, directory + ": is a file; say a directory"};
  if (std::filesystem::exists(directory, code)) {
    const bool empty = std::filesystem::is_empty(directory, code);
    if (code) return fileError(directory, code);
    if (!empty && !force)
      return Error{ErrorCode::kExists, directory +
                                           ": is not empty; choose another place, or say --force, which replaces "
                                           "the files of an earlier export"};
    if (!empty) LUMIGRID_TRY(removeEarlierExport(directory));
  }
  return base::makeDirectories(directory);
}

std::string contentName(std::uint32_t tile) {
  return std::to_string(tile / kFilesPerFolder) + "/" + std::to_string(tile) + ".glb";
}

// ---- Documents

/// `min_half`: that of a side, since viewers invert boxes.
json boxVolume(const base::Aabb& box, float min_half) {
  const glm::vec3 c = box.center(), h = glm::max(0.5F * box.size(), glm::vec3(min_half));
  return {{"box", {c.x, c.y, c.z, h.x, 0, 0, 0, h.y, 0, 0, 0, h.z}}};
}

class TilesetWriter {
 public:
  TilesetWriter(const ExportScene& scene, const std::string& directory, std::size_t tiles_per_document,
                const ExportProgress& progress)
      : scene_(scene),
        hierarchy_(scene.hierarchy()),
        directory_(directory),
        tiles_per_document_(tiles_per_document),
        progress_(progress),
        tree_(makeTileTree(hierarchy_, [&](std::uint32_t patch) { return hasPages(patch); })) {
    for (const Tile& tile : tree_.tiles) total_triangles_ += trianglesOf(tile);
  }

  Result<TilesetReport> write() {
    LUMIGRID_TRY(writeContents());
    report_.tiles = tree_.tiles.size();
    std::size_t count = 0;
    LUMIGRID_ASSIGN_OR_RETURN(auto root, describe(0, count));
    addTransform(root);
    LUMIGRID_TRY(writeDocument(kDocument, std::move(root), wholeError()));
    return report_;
  }

 private:
  // A viewer near a textured wall needs its pages, and none of those of the walls around.
  bool hasPages(std::uint32_t patch) const { return scene_.textures && !scene_.textures->pagesOf(patch).empty(); }

  std::uint64_t trianglesOf(const Tile& tile) const {
    std::uint64_t triangles = 0;
    for (const std::uint32_t p : tile.patches) triangles += hierarchy_.patches[p].triangles;
    return triangles;
  }

  Result<void> writeContents() {
    for (std::size_t t = 0; t < tree_.tiles.size(); t += kFilesPerFolder)
      LUMIGRID_TRY(base::makeDirectories(directory_ + "/" + std::to_string(t / kFilesPerFolder)));
    std::mutex mutex;
    return base::tryParallelFor(tree_.tiles.size(), 0, [&](std::size_t t) -> Result<void> {
      const Tile& tile = tree_.tiles[t];
      if (tile.patches.empty()) return {};
      LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, writeContent(static_cast<std::uint32_t>(t)));
      const std::lock_guard lock(mutex);
      report_.bytes += bytes;
      report_.triangles += trianglesOf(tile);
      const double done =
          static_cast<double>(report_.triangles) / static_cast<double>(std::max<std::uint64_t>(total_triangles_, 1));
      if (!progress_ || progress_(done, report_.bytes)) return {};
      return Error{ErrorCode::kCancelled,
                   directory_ + ": stopped; the tiles there are no tileset yet: run the command again with --force"};
    });
  }

  Result<std::uint64_t> writeContent(std::uint32_t number) const {
    const Tile& tile = tree_.tiles[number];
    const glm::ivec3 origin = floatOriginNear(hierarchy_, boxOf(hierarchy_, tile.patches).center());
    GlbWriter glb({scene_.unlit(), scene_.scene.attribution});
    LUMIGRID_TRY(addSurface(
        scene_, tile.patches, origin,
        [&](GlbPrimitive&& primitive) -> Result<void> {
          glb.add(primitive);
          return {};
        },
        nullptr));
    return glb.write(directory_ + "/" + contentName(number), tileFromMesh(hierarchy_.lattice, origin));
  }

  // The error of drawing nothing, scene units.
  double wholeError() const { return 2.0 * static_cast<double>(hierarchy_.groups[0].bounds.radius); }

  // A tile and all below it. `count` grows by the tiles that the description has.
  Result<json> describe(std::uint32_t number, std::size_t& count) {
    const Tile& tile = tree_.tiles[number];
    const bool leaf = tile.group == kNoGroup;
    const auto min_half = static_cast<float>(0.5 * hierarchy_.lattice.step);
    json j{{"geometricError", leaf ? 0.0F : tree_.errors[tile.group]},
           {"boundingVolume", boxVolume(tile.box, min_half)}};
    if (!tile.patches.empty()) j["content"]["uri"] = contentName(number);
    if (!tile.patches.empty() && !leaf)
      j["content"]["boundingVolume"] = boxVolume(boxOf(hierarchy_, tile.patches), min_half);
    ++count;
    for (const std::uint32_t child : tile.children) {
      std::size_t below = 0;
      LUMIGRID_ASSIGN_OR_RETURN(auto description, describe(child, below));
      if (below >= tiles_per_document_) {
        LUMIGRID_ASSIGN_OR_RETURN(description, referTo(std::move(description)));
        below = 1;
      }
      j["children"].push_back(std::move(description));
      count += below;
    }
    return j;
  }

  // Puts a tile into a document of its own, and returns the tile that refers to it.
  Result<json> referTo(json tile) {
    json reference{{"geometricError", tile["geometricError"]}, {"boundingVolume", tile["boundingVolume"]}};
    const std::string name = "tileset-" + std::to_string(report_.documents) + ".json";
    const double error = tile["geometricError"].get<double>();
    LUMIGRID_TRY(writeDocument(name, std::move(tile), error));
    reference["content"]["uri"] = name;
    return reference;
  }

  // World coordinates are double, and only here.
  void addTransform(json& root) const {
    const double scale = metresPerUnit(scene_.scene);
    const glm::dvec3 at = scale * scene_.scene.origin;
    if (scale == 1.0 && at == glm::dvec3(0.0)) return;
    root["transform"] = {scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0, at.x, at.y, at.z, 1};
  }

  Result<void> writeDocument(const std::string& name, json root, double error) {
    root["refine"] = "REPLACE";
    json j{{"asset", {{"version", "1.1"}}},
           {"geometricError", name == kDocument ? metresPerUnit(scene_.scene) * error : error},
           {"root", std::move(root)}};
    if (name == kDocument) {
      json extras{{"generator", "lumigrid"}, {"units", scene_.scene.units}};
      if (!scene_.scene.title.empty()) extras["title"] = scene_.scene.title;
      if (!scene_.scene.crs.empty()) extras["crs"] = scene_.scene.crs;
      if (!scene_.scene.attribution.empty()) extras["attribution"] = scene_.scene.attribution;
      j["extras"] = std::move(extras);
    }
    const std::string text = j.dump();
    LUMIGRID_TRY(base::writeFileAtomically(directory_ + "/" + name, base::viewOfText(text)));
    ++report_.documents;
    report_.bytes += text.size();
    return {};
  }

  const ExportScene& scene_;
  const lod::patch::Hierarchy& hierarchy_;
  const std::string& directory_;
  std::size_t tiles_per_document_;
  const ExportProgress& progress_;
  TileTree tree_;
  std::uint64_t total_triangles_ = 0;
  TilesetReport report_;
};

}  // namespace

Result<TilesetReport> writeTileset(const ExportScene& scene, const std::string& directory,
                                   const TilesetOptions& options, const ExportProgress& progress) {
  LUMIGRID_TRY(prepareDirectory(directory, options.force));
  return TilesetWriter(scene, directory, options.tiles_per_document, progress).write();
}

}  // namespace server::exports
