#include "server/scene/open_scene.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/json/annotations_file.h"
#include "protocol/welcome.h"
#include "repository/faces/face_value.h"
#include "repository/objects/cached_source.h"
#include "repository/objects/mirror.h"
#include "repository/objects/objects.h"
#include "repository/objects/open_objects.h"
#include "repository/repository.h"
#include "repository/sampling/parameters.h"

namespace server {
namespace {

std::string nameOf(const std::string& directory) {
  std::filesystem::path path = std::filesystem::path(directory).lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  return path.filename().string();
}

base::Result<void> setImages(std::unique_ptr<repository::Store> store, const std::string& path, OpenScene& open) {
  auto meta = store->readMeta();
  if (!meta) return base::within(path, meta.error());
  if (!meta->has_value()) return {};  // a bake that was stopped before its first batch
  LUMIGRID_ASSIGN_OR_RETURN(open.points, repository::sampledPointsFromMeta(**meta, path));
  open.data.tree = open.points.treeOrNull();
  open.data.images_are_webp = repository::codecFromMeta(**meta) == repository::nameOf(repository::ImageCodec::kWebp);
  open.images = std::move(store);
  open.data.images = open.images.get();
  open.data.welcome.grid = open.points.grid;

  // Damaged patches are reported when they are read for a client; images are chosen without occlusion then.
  auto sight = lod::patch::ProxySight::ofFile(open.patches);
  if (!sight) return {};
  open.sight = std::make_unique<lod::patch::ProxySight>(std::move(*sight));
  open.sight_cache = std::make_unique<plan::SightCache>(*open.sight, plan::sightClearance(*open.sight));
  open.data.sight = open.sight.get();
  open.data.sight_cache = open.sight_cache.get();
  return {};
}

base::Result<void> openImages(const std::string& directory, OpenScene& open) {
  if (const auto index = base::partFile(open.scene, "images/index", ".lgi")) {
    LUMIGRID_ASSIGN_OR_RETURN(auto packs, openPacks(directory, *index));
    repository::PackStore* opened = packs.get();
    LUMIGRID_TRY(setImages(std::move(packs), directory + "/" + *index, open));
    open.packs = opened;
    return {};
  }
  const std::string path = directory + "/images";
  std::error_code ignored;
  if (!std::filesystem::is_directory(path, ignored)) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto store, repository::openRepository(path));
  return setImages(std::move(store), path, open);
}

}  // namespace

repository::AccessIdentity accessIdentityOf(const OpenScene& open) {
  return {open.data.welcome.grid, open.data.welcome.group_count, base::hierarchyDigest(open.scene)};
}

base::Result<std::unique_ptr<repository::PackStore>> openPacks(const std::string& directory, const std::string& index) {
  LUMIGRID_ASSIGN_OR_RETURN(auto source, repository::openDirectorySource(directory));
  return repository::PackStore::open(std::move(source), index);
}

base::Result<base::Bytes> readSceneJson(const repository::ObjectSource& source) {
  constexpr std::uint64_t kMaxJsonBytes = std::uint64_t{16} << 20;
  LUMIGRID_ASSIGN_OR_RETURN(auto size, source.size("scene.json"));
  if (size > kMaxJsonBytes)
    return base::Error{base::ErrorCode::kInvalidInput,
                       source.place() + "/scene.json: of " + std::to_string(size) + " bytes, which no scene's is"};
  return source.read("scene.json", 0, size);
}

namespace {

constexpr unsigned kRemoteReads = 8;  // under way at a time for the images of one view

/// Names what viewers of patches change over to, by the files that were opened: scene.json may list others, too.
void setMethodInstead(OpenScene& open) {
  if (open.data.patches != nullptr || open.streamed.empty()) return;
  open.data.instead = protocol::streamedOf(open.streamed.front().method.name);
}

std::unique_ptr<OpenScene> openDocument(base::Scene scene, base::Bytes json_bytes, const std::string& place) {
  auto open = std::make_unique<OpenScene>();
  open->scene = std::move(scene);
  open->scene_json = std::move(json_bytes);
  open->name = nameOf(place);
  open->data.welcome = protocol::welcomeOf(open->scene, open->name);
  open->data.on_read_error = [errors = open->read_errors.get()](const base::Error& error) {
    errors->report("scene", error);
  };
  return open;
}

/// A number that differs when a store of the scene's images was replaced by another file; 0 where there is none.
std::uint64_t imagesIdentity(const std::string& directory) {
  std::uint64_t sum = 0;
  std::error_code ignored;
  std::filesystem::recursive_directory_iterator entry(directory + "/images", ignored);
  // A loop over a range would throw where a folder goes meanwhile.
  for (; entry != std::filesystem::recursive_directory_iterator(); entry.increment(ignored)) {
    struct stat status {};
    if (entry->path().filename() == "data.mdb" && ::stat(entry->path().c_str(), &status) == 0)
      sum += status.st_ino * 0x9E3779B97F4A7C15U;
  }
  return sum;
}

base::Result<base::Scene> readSceneAt(const std::string& place) {
  if (!repository::isRemotePlace(place)) return base::readScene(place);
  LUMIGRID_ASSIGN_OR_RETURN(const auto source, repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, readSceneJson(*source));
  return base::parseScene(std::string(bytes.begin(), bytes.end()), place + "/scene.json");
}

base::Result<void> openHierarchy(const std::string& path, OpenScene& open) {
  LUMIGRID_ASSIGN_OR_RETURN(open.patches, lod::patch::PatchFile::open(path));
  LUMIGRID_ASSIGN_OR_RETURN(open.patch_file, OpenFile::open(path));
  open.data.patches = &open.patches;
  describeHierarchy(open.patches.hierarchy(), open.data.welcome);
  (void)startOf(open.data);  // chooses the coarse model here, so that the first viewer need not wait for it
  return {};
}

base::Result<std::string> cacheDirectory(const RemoteOptions& options, const std::string& place) {
  const std::string directory = options.cache_directory.empty() ? defaultCacheDirectory() : options.cache_directory;
  if (directory.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": no home directory to keep a cache in; name one with --cache"};
  return directory;
}

/// Reads through the cache in `directory`, whose limit is for all sources that use it together.
base::Result<std::unique_ptr<repository::CachedSource>> openCachedSource(
    std::shared_ptr<const repository::ObjectSource> source, const std::string& directory,
    const RemoteOptions& options) {
  return repository::CachedSource::open(std::move(source), directory, {options.cache_bytes, options.warn});
}

base::Result<void> openRemoteImages(std::unique_ptr<repository::CachedSource> source, const std::string& index,
                                    OpenScene& open) {
  const std::string place = source->place() + "/" + index;
  repository::PackStoreOptions reads;
  reads.jobs = kRemoteReads;
  LUMIGRID_ASSIGN_OR_RETURN(auto packs, repository::PackStore::open(std::move(source), index, reads));
  repository::PackStore* opened = packs.get();
  LUMIGRID_TRY(setImages(std::move(packs), place, open));
  open.packs = opened;
  open.data.images_are_remote = true;
  return {};
}

/// Null when the scene does not list the part, or under a name without the id that published parts have.
const base::ScenePart* publishedPart(const base::Scene& scene, const std::string& stem, const std::string& extension) {
  const auto name = base::partFile(scene, stem, extension);
  if (!name || !base::isPublishedName(*name)) return nullptr;
  const auto part = std::find_if(scene.parts.begin(), scene.parts.end(),
                                 [&](const base::ScenePart& one) { return one.file == *name; });
  return part == scene.parts.end() ? nullptr : &*part;
}

// Frames are drawn with textures, and with what throws shadows, that lie beside the patches. A scene of which they
// cannot be had is served as one that was published without them.
void mirrorForFrames(const repository::ObjectSource& source, const std::string& directory, const RemoteOptions& options,
                     OpenScene& open) {
  const auto mirror = [&](const base::ScenePart* part, const char* called) {
    if (part == nullptr) return;
    const std::string file = part->file;
    const auto path = repository::mirrorObject(source, file, directory, part->sha256);
    if (path) return;
    if (options.warn) options.warn("no " + std::string(called) + ": " + path.error().message);
    std::erase_if(open.scene.parts, [&](const base::ScenePart& one) { return one.file == file; });
  };
  mirror(publishedPart(open.scene, "texture", ".lgt"), "textures");
  const base::StreamedMethod& nodes = base::kHlodMethod;
  if (open.scene.light.hasShadows()) mirror(publishedPart(open.scene, nodes.name, nodes.extension), "shadows");
}

// A scene is served without annotations when they are absent or damaged.
void readRemoteAnnotations(const repository::ObjectSource& source, const RemoteOptions& options, OpenScene& open) {
  const auto read = [&]() -> base::Result<base::Bytes> {
    LUMIGRID_ASSIGN_OR_RETURN(auto size, source.size(base::kAnnotationsFile));
    return source.read(base::kAnnotationsFile, 0, std::min<std::uint64_t>(size, base::kMaxAnnotationsBytes + 1));
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

base::Result<void> openRemoteStreamed(const std::shared_ptr<const repository::ObjectSource>& source,
                                      const std::string& directory, const RemoteOptions& options, OpenScene& open) {
  for (const base::StreamedMethod& method : base::kStreamedMethods) {
    const base::ScenePart* part = publishedPart(open.scene, method.name, method.extension);
    if (part == nullptr) continue;
    LUMIGRID_ASSIGN_OR_RETURN(auto cached, openCachedSource(source, directory, options));
    open.streamed.push_back({method, part->bytes, std::move(cached)});
  }
  return {};
}

base::Result<void> openStreamed(const std::string& directory, OpenScene& open) {
  for (const base::StreamedMethod& method : base::kStreamedMethods) {
    if (!base::partFile(open.scene, method.name, method.extension)) continue;
    LUMIGRID_ASSIGN_OR_RETURN(auto file, OpenFile::open(base::streamedPath(directory, open.scene, method)));
    const std::uint64_t bytes = file->size();
    open.streamed.push_back({method, bytes, std::move(file)});
  }
  return {};
}

// Opens a published scene behind a network. Every object but scene.json is named by its content, so caches stay valid.
base::Result<std::unique_ptr<OpenScene>> openRemoteScene(const std::string& place, const RemoteOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto directory, cacheDirectory(options, place));
  LUMIGRID_ASSIGN_OR_RETURN(const std::shared_ptr<const repository::ObjectSource> source,
                            repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(auto json_bytes, readSceneJson(*source));
  LUMIGRID_ASSIGN_OR_RETURN(auto scene,
                            base::parseScene(std::string(json_bytes.begin(), json_bytes.end()), place + "/scene.json"));

  std::unique_ptr<OpenScene> open = openDocument(std::move(scene), std::move(json_bytes), place);
  const base::ScenePart* patches = publishedPart(open->scene, "patch", ".lgp");
  const auto index = base::partFile(open->scene, "images/index", ".lgi");
  LUMIGRID_TRY(openRemoteStreamed(source, directory, options, *open));
  if (patches == nullptr && open->streamed.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};
  if (patches != nullptr) {
    LUMIGRID_ASSIGN_OR_RETURN(
        const auto path, repository::mirrorObject(*source, patches->file, directory + "/hierarchies", patches->sha256));
    LUMIGRID_TRY(openHierarchy(path, *open));
    mirrorForFrames(*source, directory + "/hierarchies", options, *open);
  }
  if (patches != nullptr && index) {
    LUMIGRID_ASSIGN_OR_RETURN(auto far, openCachedSource(source, directory, options));
    LUMIGRID_TRY(openRemoteImages(std::move(far), *index, *open));
  }
  readRemoteAnnotations(*source, options, *open);
  setMethodInstead(*open);
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
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(place));
  LUMIGRID_ASSIGN_OR_RETURN(auto json_bytes, base::readFile(place + "/scene.json"));
  std::unique_ptr<OpenScene> open = openDocument(std::move(scene), std::move(json_bytes), place);
  open->directory = place;
  open->images_identity = imagesIdentity(place);
  LUMIGRID_TRY(openStreamed(place, *open));
  if (!open->streamed.empty() && !base::partFile(open->scene, "patch", ".lgp")) {
    setMethodInstead(*open);
    return open;
  }
  LUMIGRID_TRY(openHierarchy(base::patchPath(place, open->scene), *open));
  LUMIGRID_TRY(openImages(place, *open));
  return open;
}

const StreamedFile* streamedFile(const OpenScene& open, const base::StreamedMethod& method) {
  const auto it = std::find_if(open.streamed.begin(), open.streamed.end(), [&](const StreamedFile& one) {
    return std::string_view(one.method.name) == method.name;
  });
  return it == open.streamed.end() ? nullptr : &*it;
}

bool isSameBuild(const base::Scene& a, const base::Scene& b) {
  const auto parts = [](const base::Scene& scene) {
    std::vector<std::tuple<std::string, std::uint64_t, std::string>> all;
    for (const base::ScenePart& part : scene.parts) all.emplace_back(part.file, part.bytes, part.sha256);
    return all;
  };
  return a.box_min == b.box_min && a.box_max == b.box_max && a.origin == b.origin && a.triangles == b.triangles &&
         parts(a) == parts(b);
}

bool isReplaced(const OpenScene& open, const std::string& place) {
  const auto now = readSceneAt(place);
  if (!now) return false;
  return !isSameBuild(*now, open.scene) || (!open.directory.empty() && imagesIdentity(place) != open.images_identity);
}

bool lacksTextures(const OpenScene& open) {
  return open.data.patches != nullptr && !base::partFile(open.scene, "texture", ".lgt") &&
         hasTextures(open.patches.hierarchy());
}

bool lacksShadows(const OpenScene& open) {
  return open.scene.light.hasShadows() &&
         !base::partFile(open.scene, base::kHlodMethod.name, base::kHlodMethod.extension);
}

}  // namespace server
