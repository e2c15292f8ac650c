#include "server/net/open_scene.h"

#include <filesystem>
#include <utility>

#include "repository/parameters.h"
#include "repository/repository.h"

namespace server {
namespace {

std::string nameOf(const std::string& directory) {
  std::filesystem::path path = std::filesystem::path(directory).lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  return path.filename().string();
}

base::Result<void> openImages(const std::string& path, OpenScene& open) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(path, ignored)) return {};
  auto store = repository::openRepository(path);
  if (!store) return store.error();
  auto meta = (*store)->readMeta();
  if (!meta) return base::within(path, meta.error());
  if (!meta->has_value()) return {};  // a bake that was stopped before its first batch
  auto grid = repository::gridFromMeta(**meta, path);
  if (!grid) return grid.error();
  open.images = std::move(*store);
  open.data.images = open.images.get();
  open.data.welcome.grid = *grid;
  return {};
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

base::Result<std::unique_ptr<OpenScene>> openScene(const std::string& directory) {
  auto scene = base::readScene(directory);
  if (!scene) return scene.error();
  auto json_bytes = base::readFile(directory + "/scene.json");
  if (!json_bytes) return json_bytes.error();
  auto patches = lod::patch::PatchFile::open(directory + "/patch.lgp");
  if (!patches) return patches.error();
  auto mapped = base::MappedFile::open(directory + "/patch.lgp");
  if (!mapped) return mapped.error();

  std::unique_ptr<OpenScene> open(
      new OpenScene{std::move(*scene), std::move(*patches), nullptr, std::move(*json_bytes), std::move(*mapped), {}});
  open->data.patches = &open->patches;
  describe(directory, *open);
  LUMIGRID_TRY(openImages(directory + "/images", *open));
  return open;
}

}  // namespace server
