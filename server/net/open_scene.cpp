#include "server/net/open_scene.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "repository/cached_source.h"
#include "repository/mirror.h"
#include "repository/open_objects.h"

namespace server {
namespace {

using nlohmann::json;

/// Three numbers, or false.
template <class Vector>
bool readVector(const json& parent, const char* key, Vector& v) {
  const auto it = parent.find(key);
  if (it == parent.end() || !it->is_array() || it->size() != 3) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const json& number = (*it)[static_cast<std::size_t>(axis)];
    if (std::is_integral_v<typename Vector::value_type> ? !number.is_number_unsigned() : !number.is_number())
      return false;
    v[axis] = number.get<typename Vector::value_type>();
  }
  return true;
}

std::string nameOf(const std::string& directory) {
  std::filesystem::path path = std::filesystem::path(directory).lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  return path.filename().string();
}

base::Result<void> takeImages(std::unique_ptr<repository::Store> store, const std::string& path, OpenScene& open) {
  auto meta = store->readMeta();
  if (!meta) return base::within(path, meta.error());
  if (!meta->has_value()) return {};  // a bake that was stopped before its first batch
  auto points = sampledPointsFromMeta(**meta, path);
  if (!points) return points.error();
  open.points = std::move(*points);
  open.growth = growthFromText(**meta);
  open.data.tree = open.points.treeOrNull();
  open.images = std::move(store);
  open.data.images = open.images.get();
  open.data.welcome.grid = open.points.grid;
  return {};
}

base::Result<void> openImages(const std::string& directory, OpenScene& open) {
  if (const auto index = base::partFile(open.scene, "images/index", ".lgi")) {
    auto packs = openPacks(directory, *index);
    if (!packs) return packs.error();
    repository::PackStore* opened = packs->get();
    LUMIGRID_TRY(takeImages(std::move(*packs), directory + "/" + *index, open));
    open.packs = opened;
    return {};
  }
  const std::string path = directory + "/images";
  std::error_code ignored;
  if (!std::filesystem::is_directory(path, ignored)) return {};
  auto store = repository::openLmdbStore(path, repository::StoreMode::kRead);
  if (!store) return store.error();
  return takeImages(std::move(*store), path, open);
}

void describe(const std::string& directory, OpenScene& open) {
  const base::Scene& scene = open.scene;
  const lod::patch::Hierarchy& hierarchy = open.patches.hierarchy();
  const base::Aabb box = scene.localBox();
  protocol::Welcome& welcome = open.data.welcome;
  welcome.scene_name = nameOf(directory);
  welcome.origin = scene.origin;
  welcome.box_min = box.min;
  welcome.box_max = box.max;
  welcome.up = glm::vec3(scene.up);
  welcome.unlit = scene.light.mode == base::LightMode::kUnlit;
  welcome.light_direction = scene.light.direction;
  welcome.has_colors = hierarchy.has_colors;
  welcome.lattice_origin = hierarchy.lattice.origin;
  welcome.lattice_step = hierarchy.lattice.step;
  welcome.group_count = static_cast<std::uint32_t>(hierarchy.groups.size());
  welcome.patch_count = static_cast<std::uint32_t>(hierarchy.patches.size());
  welcome.source_triangles = hierarchy.source_triangles;
}

}  // namespace

repository::AccessIdentity accessIdentityOf(const OpenScene& open) {
  return {open.data.welcome.grid, open.data.welcome.group_count};
}

base::Result<repository::Grid> gridFromMeta(const std::string& meta, const std::string& name) {
  const base::Error wrong{
      base::ErrorCode::kInvalidInput,
      name + ": the repository's parameters hold no valid grid; build the images again with `lumigrid build`"};
  const json root = json::parse(meta, nullptr, false);
  if (!root.is_object() || !root.contains("grid") || !root["grid"].is_object()) return wrong;
  const json& object = root["grid"];
  repository::Grid grid;
  if (!readVector(object, "first", grid.first) || !readVector(object, "count", grid.count)) return wrong;
  const auto spacing = object.find("spacing");
  const auto face_size = object.find("face_size");
  if (spacing == object.end() || !spacing->is_number() || face_size == object.end() || !face_size->is_number_unsigned())
    return wrong;
  grid.spacing = spacing->get<float>();
  grid.face_size = face_size->get<std::uint32_t>();

  // The checks of values live in one place: where a grid is decoded.
  base::ByteWriter out;
  grid.encode(out);
  base::ByteReader in(out.view());
  auto checked = repository::Grid::decode(in);
  return checked ? std::move(checked) : base::within(name, checked.error());
}

base::Result<SampledPoints> sampledPointsFromMeta(const std::string& meta, const std::string& name) {
  auto grid = gridFromMeta(meta, name);
  if (!grid) return grid.error();
  auto tree = treeFromText(meta, *grid, name);
  if (!tree) return tree.error();
  return SampledPoints{*grid, std::move(*tree)};
}

base::Result<std::unique_ptr<repository::PackStore>> openPacks(const std::string& directory, const std::string& index) {
  auto source = repository::openDirectorySource(directory);
  if (!source) return source.error();
  return repository::PackStore::open(std::move(*source), index);
}

namespace {

constexpr std::uint64_t kMostJsonBytes = std::uint64_t{16} << 20;
constexpr unsigned kRemoteReads = 8;  // under way at a time for the images of one view

// Everything but the images.
base::Result<std::unique_ptr<OpenScene>> openHierarchy(base::Scene scene, base::Bytes json_bytes,
                                                       const std::string& patch_path, const std::string& place) {
  auto patches = lod::patch::PatchFile::open(patch_path);
  if (!patches) return patches.error();
  auto mapped = base::MappedFile::open(patch_path);
  if (!mapped) return mapped.error();
  std::unique_ptr<OpenScene> open(new OpenScene{
      std::move(scene), std::move(*patches), nullptr, nullptr, {}, {}, std::move(json_bytes), std::move(*mapped), {}});
  open->data.patches = &open->patches;
  describe(place, *open);
  return open;
}

base::Result<base::Bytes> readRoot(const repository::ObjectSource& source) {
  auto size = source.size("scene.json");
  if (!size) return size.error();
  if (*size > kMostJsonBytes)
    return base::Error{base::ErrorCode::kInvalidInput,
                       source.place() + "/scene.json: of " + std::to_string(*size) + " bytes, which no scene's is"};
  return source.read("scene.json", 0, *size);
}

base::Result<std::string> cacheDirectory(const RemoteOptions& options, const std::string& place) {
  const std::string directory = options.cache_directory.empty() ? defaultCacheDirectory() : options.cache_directory;
  if (directory.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": no home directory to keep a cache in; name one with --cache"};
  return directory;
}

base::Result<void> openRemoteImages(std::shared_ptr<const repository::ObjectSource> source, const std::string& index,
                                    const std::string& directory, const RemoteOptions& options, OpenScene& open) {
  repository::CachedSourceOptions cache;
  cache.cache.bytes = options.cache_bytes;
  cache.cache.warn = options.warn;
  const std::string place = source->place() + "/" + index;
  auto cached = repository::CachedSource::open(std::move(source), directory, cache);
  if (!cached) return cached.error();
  repository::PackStoreOptions reads;
  reads.jobs = kRemoteReads;
  auto packs = repository::PackStore::open(std::move(*cached), index, reads);
  if (!packs) return packs.error();
  repository::PackStore* opened = packs->get();
  LUMIGRID_TRY(takeImages(std::move(*packs), place, open));
  open.packs = opened;
  return {};
}

// A published scene behind a network. Every object but scene.json is named by its content.
base::Result<std::unique_ptr<OpenScene>> openRemoteScene(const std::string& place, const RemoteOptions& options) {
  const auto directory = cacheDirectory(options, place);
  if (!directory) return directory.error();
  auto opened = repository::openObjectSource(place);
  if (!opened) return opened.error();
  const std::shared_ptr<const repository::ObjectSource> source = std::move(*opened);
  auto json_bytes = readRoot(*source);
  if (!json_bytes) return json_bytes.error();
  auto scene = base::parseScene(std::string(json_bytes->begin(), json_bytes->end()), place + "/scene.json");
  if (!scene) return scene.error();

  const auto name = base::partFile(*scene, "patch", ".lgp");
  const auto index = base::partFile(*scene, "images/index", ".lgi");
  const auto part = std::find_if(scene->parts.begin(), scene->parts.end(),
                                 [&](const base::ScenePart& p) { return name && p.file == *name; });
  if (part == scene->parts.end() || !base::isPublishedName(*name))
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};
  const auto patch_path = repository::mirrorObject(*source, *name, *directory + "/hierarchies", part->sha256);
  if (!patch_path) return patch_path.error();
  auto open = openHierarchy(std::move(*scene), std::move(*json_bytes), *patch_path, place);
  if (open && index) LUMIGRID_TRY(openRemoteImages(source, *index, *directory, options, **open));
  return open;
}

}  // namespace

std::string defaultCacheDirectory() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache != nullptr && cache[0] == '/')
    return std::string(cache) + "/lumigrid";
  const char* home = std::getenv("HOME");
  return home != nullptr && home[0] == '/' ? std::string(home) + "/.cache/lumigrid" : "";
}

base::Result<std::unique_ptr<OpenScene>> openScene(const std::string& place, const RemoteOptions& options) {
  if (repository::isRemotePlace(place)) return openRemoteScene(place, options);
  auto scene = base::readScene(place);
  if (!scene) return scene.error();
  auto json_bytes = base::readFile(place + "/scene.json");
  if (!json_bytes) return json_bytes.error();
  const std::string patch_path = base::patchPath(place, *scene);
  auto open = openHierarchy(std::move(*scene), std::move(*json_bytes), patch_path, place);
  if (open) LUMIGRID_TRY(openImages(place, **open));
  return open;
}

}  // namespace server
