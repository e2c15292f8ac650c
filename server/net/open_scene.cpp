#include "server/net/open_scene.h"

#include <filesystem>
#include <utility>

#include "repository/objects.h"
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

base::Result<std::unique_ptr<OpenScene>> openScene(const std::string& directory) {
  auto scene = base::readScene(directory);
  if (!scene) return scene.error();
  auto json_bytes = base::readFile(directory + "/scene.json");
  if (!json_bytes) return json_bytes.error();
  const std::string patch_path = base::patchPath(directory, *scene);
  auto patches = lod::patch::PatchFile::open(patch_path);
  if (!patches) return patches.error();
  auto mapped = base::MappedFile::open(patch_path);
  if (!mapped) return mapped.error();

  std::unique_ptr<OpenScene> open(new OpenScene{std::move(*scene),
                                                std::move(*patches),
                                                nullptr,
                                                nullptr,
                                                {},
                                                {},
                                                std::move(*json_bytes),
                                                std::move(*mapped),
                                                {}});
  open->data.patches = &open->patches;
  describe(directory, *open);
  LUMIGRID_TRY(openImages(directory, *open));
  return open;
}

}  // namespace server
