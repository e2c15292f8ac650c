#include "server/net/open_scene.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "base/json/annotations_file.h"
#include "repository/cached_source.h"
#include "repository/mirror.h"
#include "repository/objects.h"
#include "repository/open_objects.h"
#include "repository/parameters.h"
#include "repository/repository.h"

namespace server {
namespace {

std::string nameOf(const std::string& directory) {
  std::filesystem::path path = std::filesystem::path(directory).lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  return path.filename().string();
}

base::Result<void> takeImages(std::unique_ptr<repository::Store> store, const std::string& path, OpenScene& open) {
  auto meta = store->readMeta();
  if (!meta) return base::within(path, meta.error());
  if (!meta->has_value()) return {};  // a bake that was stopped before its first batch
  auto points = repository::sampledPointsFromMeta(**meta, path);
  if (!points) return points.error();
  open.points = std::move(*points);
  open.growth = repository::growthFromText(**meta);
  open.data.tree = open.points.treeOrNull();
  open.images = std::move(store);
  open.data.images = open.images.get();
  open.data.welcome.grid = open.points.grid;

  // Damaged patches are told where they are read for a client; until then images are chosen without.
  auto sight = lod::patch::ProxySight::ofFile(open.patches);
  if (sight) open.sight = std::make_unique<lod::patch::ProxySight>(std::move(*sight));
  open.data.sight = open.sight.get();
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
  auto store = repository::openRepository(path);
  if (!store) return store.error();
  return takeImages(std::move(*store), path, open);
}

void describe(const std::string& directory, OpenScene& open) {
  const base::Scene& scene = open.scene;
  const lod::patch::Hierarchy& hierarchy = open.patches.hierarchy();
  const base::Aabb box = scene.localBox();
  protocol::Welcome& welcome = open.data.welcome;
  welcome.scene_name = nameOf(directory);
  welcome.units = scene.units == "unknown" ? "" : scene.units;
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

base::Result<std::unique_ptr<repository::PackStore>> openPacks(const std::string& directory, const std::string& index) {
  auto source = repository::openDirectorySource(directory);
  if (!source) return source.error();
  return repository::PackStore::open(std::move(*source), index);
}

base::Result<base::Bytes> readSceneJson(const repository::ObjectSource& source) {
  constexpr std::uint64_t kMostJsonBytes = std::uint64_t{16} << 20;
  auto size = source.size("scene.json");
  if (!size) return size.error();
  if (*size > kMostJsonBytes)
    return base::Error{base::ErrorCode::kInvalidInput,
                       source.place() + "/scene.json: of " + std::to_string(*size) + " bytes, which no scene's is"};
  return source.read("scene.json", 0, *size);
}

namespace {

constexpr unsigned kRemoteReads = 8;  // under way at a time for the images of one view

// Everything but the images.
base::Result<std::unique_ptr<OpenScene>> openHierarchy(base::Scene scene, base::Bytes json_bytes,
                                                       const std::string& patch_path, const std::string& place) {
  auto patches = lod::patch::PatchFile::open(patch_path);
  if (!patches) return patches.error();
  auto mapped = base::MappedFile::open(patch_path);
  if (!mapped) return mapped.error();
  auto open = std::make_unique<OpenScene>();
  open->scene = std::move(scene);
  open->patches = std::move(*patches);
  open->scene_json = std::move(json_bytes);
  open->patch_bytes = std::move(*mapped);
  open->data.patches = &open->patches;
  describe(place, *open);
  return open;
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
  open.data.images_are_far = true;
  return {};
}

// They are no part of the scene: without them, or with bad ones, it is served all the same.
void readRemoteAnnotations(const repository::ObjectSource& source, const RemoteOptions& options, OpenScene& open) {
  const auto read = [&]() -> base::Result<base::Bytes> {
    auto size = source.size(base::kAnnotationsFile);
    if (!size) return size.error();
    return source.read(base::kAnnotationsFile, 0, std::min<std::uint64_t>(*size, base::kMaxAnnotationsBytes + 1));
  };
  auto bytes = read();
  if (!bytes && bytes.error().code == base::ErrorCode::kNotFound) return;
  const auto notes = bytes ? base::parseAnnotations(*bytes, source.place() + "/" + base::kAnnotationsFile)
                           : base::Result<std::vector<base::Annotation>>(bytes.error());
  if (notes)
    open.annotations_json.assign(bytes->begin(), bytes->end());
  else if (options.warn)
    options.warn("no annotations: " + notes.error().message);
}

// A published scene behind a network. Every object but scene.json is named by its content.
base::Result<std::unique_ptr<OpenScene>> openRemoteScene(const std::string& place, const RemoteOptions& options) {
  const auto directory = cacheDirectory(options, place);
  if (!directory) return directory.error();
  auto opened = repository::openObjectSource(place);
  if (!opened) return opened.error();
  const std::shared_ptr<const repository::ObjectSource> source = std::move(*opened);
  auto json_bytes = readSceneJson(*source);
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
  if (!open) return open;
  if (index) LUMIGRID_TRY(openRemoteImages(source, *index, *directory, options, **open));
  readRemoteAnnotations(*source, options, **open);
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
  if (base::partFile(*scene, "qsplat", ".lgq") && !base::partFile(*scene, "patch", ".lgp"))
    return base::Error{base::ErrorCode::kUnsupported,
                       place +
                           ": holds a tree of splats alone; publish it (`lumigrid publish`) and any web server shows it, "
                           "or build patches too (--methods patch,qsplat), which needs a mesh"};
  const std::string patch_path = base::patchPath(place, *scene);
  auto open = openHierarchy(std::move(*scene), std::move(*json_bytes), patch_path, place);
  if (!open) return open;
  (*open)->directory = place;
  if (base::partFile((*open)->scene, "qsplat", ".lgq")) {
    auto splats = base::MappedFile::open(base::splatPath(place, (*open)->scene));
    if (!splats) return splats.error();
    (*open)->splat_bytes = std::move(*splats);
  }
  LUMIGRID_TRY(openImages(place, **open));
  return open;
}

}  // namespace server
