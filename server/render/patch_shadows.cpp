#include "server/render/patch_shadows.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "server/render/sample_target.h"
#include "server/render/scene_light.h"
#include "server/render/streamed_scene.h"

namespace server {
namespace {

/// Shadows of leaves are as near to the truth as the paper's, and others no nearer than a pixel: casters for half a
/// pixel take eight times as long (statue of 200 000 triangles, 512 pixels).
constexpr float kHalfPixelOff = 0.5F, kPixelOff = 1.0F;

/// Each layer that software GL has not drawn yet takes up to 36 MB. With two it always has one to draw.
constexpr std::size_t kLayersQueued = 2;

/// The view's own map, the scene's finest one, and the coarser ones of that, which take a third of it together. Own
/// maps may have a texture of twice their size.
constexpr std::uint64_t kMapsKept = 4;

/// The most that a map takes.
std::uint64_t mapBytes(const base::Light& light) {
  constexpr std::uint64_t kBytesPerTexel = 4;
  const bool is_soft = light.mode == base::LightMode::kSoftShadows;
  const std::uint64_t side = is_soft ? lod::draw::kSoftTexels : lod::draw::kHardTexels;
  return kBytesPerTexel * (is_soft ? lod::draw::kMaxLightLayers : 1) * side * side;
}

/// Soft shadows are as fine as pictures of so many pixels a side need. In images of 992, shadows for 992 take twice the
/// time and memory of shadows for 496, and change what is seen by 0.04 of 255 (machangara, in the thin client).
constexpr int kSoftPixels = 768;

base::Camera withFewerPixels(base::Camera camera) {
  const int side = std::max(camera.width, camera.height);
  if (side <= kSoftPixels) return camera;
  camera.width = std::max(camera.width * kSoftPixels / side, 1);
  camera.height = std::max(camera.height * kSoftPixels / side, 1);
  return camera;
}

constexpr int kUnseen = std::numeric_limits<int>::min();  // in place of a level

/// Patches are as far away from the eye as others of their level within a factor of 2, and those of the same tolerance
/// have errors in proportion to that.
std::uint32_t levelOf(const base::Camera& camera, const base::Sphere& bounds) {
  if (camera.orthographic()) return 0;
  constexpr int kFarthest = 1024;  // more than a float's exponents
  const float distance = glm::length(bounds.center - camera.eye) - bounds.radius;
  const float least = std::max(1e-3F * bounds.radius, std::numeric_limits<float>::min());
  return static_cast<std::uint32_t>(kFarthest - std::ilogb(std::max(distance, least)));
}

}  // namespace

PatchShadows::PatchShadows(std::string path, const std::shared_ptr<const lod::FileBytes>& file,
                           const base::Scene& scene, const base::Light& light)
    : path_(std::move(path)),
      stream_(file, wholeFile<lod::hlod::StreamOptions>()),
      light_{shadowsOf(light, scene.origin).light, static_cast<std::uint32_t>(SampleTarget::maxSide())} {}

base::Result<std::unique_ptr<PatchShadows>> PatchShadows::create(const std::string& directory, const base::Scene& scene,
                                                                 const base::Light& light) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, openStreamedFile(directory, scene, base::kHlodMethod));
  std::unique_ptr<PatchShadows> made(new PatchShadows(file.path, file.bytes, scene, light));
  LUMIGRID_TRY(checkStream(made->stream_, file.path));
  LUMIGRID_ASSIGN_OR_RETURN(made->shadow_map_, lod::draw::ShadowMap::create(kStreamedGpuBytes));
  made->shadow_map_->setKeptBytes(kMapsKept * mapBytes(light));
  made->shadow_map_->setLayersQueued(kLayersQueued);
  return made;
}

std::uint64_t PatchShadows::memoryFor(const base::Light& light, std::uint64_t triangles) {
  if (!light.hasShadows()) return 0;
  // A caster takes 12 bytes a triangle and about as much again for its positions, here and on the GPU.
  constexpr std::uint64_t kBytesPerTriangle = 40;
  // With llvmpipe images of 1984 pixels, whose maps are up to that large, were seen to take 1.7 GB more with soft
  // shadows than without.
  constexpr std::uint64_t kMapsHeld = 7;
  const std::uint64_t casters = std::min(triangles, (kStreamedDecodedBytes + kStreamedGpuBytes) / kBytesPerTriangle);
  return kBytesPerTriangle * casters + kMapsHeld * mapBytes(light);
}

const PatchShadows::SceneMap& PatchShadows::sceneMap(int level) {
  const auto known = scene_maps_.find(level);
  if (known != scene_maps_.end()) return known->second;
  auto map = lod::draw::findSceneShadows(stream_, scene_request_, std::ldexp(1.0, level), light_);
  return scene_maps_[level] = {std::move(map), kFirstSceneSlot + scene_maps_.size()};
}

/// For each patch whether a map of the scene is fine enough; takes the finest map that any needs and that can be had.
/// Returns its level, or kUnseen.
int PatchShadows::findSceneMap(const lod::hlod::TraverseRequest& view, const lod::patch::Hierarchy& hierarchy,
                               std::span<const std::uint32_t> patches, std::vector<bool>& served) {
  std::vector<int> levels;
  for (const std::uint32_t patch : patches) {
    const double scale = lod::hlod::largestScale(view, hierarchy.patches[patch].box);
    levels.push_back(scale > 0.0 ? static_cast<int>(std::floor(std::log2(scale))) : kUnseen);
  }
  std::vector<int> falling = levels;
  std::sort(falling.begin(), falling.end(), std::greater<>());
  const auto finest =
      std::find_if(falling.begin(), falling.end(), [&](int level) { return level == kUnseen || sceneMap(level).map; });
  if (finest == falling.end() || *finest == kUnseen) return kUnseen;
  for (std::size_t i = 0; i < levels.size(); ++i) served[i] = levels[i] != kUnseen && levels[i] <= *finest;
  return *finest;
}

base::Result<void> PatchShadows::plan(const lod::hlod::TraverseRequest& view, const lod::patch::Hierarchy& hierarchy,
                                      std::span<const std::uint32_t> patches, bool one_of_many) {
  // Only the nodes' casters are of use. The root's picture stands for all, as a view must have some.
  lod::hlod::TraverseRequest coarsest = view;
  coarsest.tolerance = std::numeric_limits<float>::infinity();
  std::vector<lod::hlod::DrawnNode> root;
  stream_.update(coarsest, root);

  lod::hlod::TraverseRequest shadowed = view;
  if (light_.light.size > 0.0F) shadowed.camera = withFewerPixels(view.camera);
  shadowed.tolerance = view.tolerance > 0.0F ? std::max(view.tolerance, kPixelOff) : kHalfPixelOff;
  // The view's pixels may be half as large as those of the scene's map, whose texels may be twice as large as wanted,
  // as those of the view's own maps may be.
  const float scene_tolerance = 0.5F * shadowed.tolerance;
  glm::vec4& section = scene_request_.camera.section;
  if (scene_tolerance != scene_request_.tolerance || view.camera.section != section) scene_maps_.clear();
  if (scene_maps_.empty()) scene_request_.tolerance = scene_tolerance, section = view.camera.section;

  std::vector<bool> is_shared(patches.size(), false);
  const int level = one_of_many ? findSceneMap(shadowed, hierarchy, patches, is_shared) : kUnseen;
  std::vector<std::uint32_t> shared, own, lit;  // places in the list of patches
  std::vector<lod::hlod::ShadowReceiver> boxes;
  for (std::uint32_t i = 0; i < patches.size(); ++i) {
    (is_shared[i] ? shared : own).push_back(i);
    const lod::patch::Patch& patch = hierarchy.patches[patches[i]];
    if (!is_shared[i]) boxes.push_back({patch.box, levelOf(view.camera, patch.bounds)});
  }

  // A finder remembers maps, and a picture must not depend on those that were drawn before.
  own_ = lod::draw::NodeShadowFinder().find(stream_, boxes, shadowed, light_);
  LUMIGRID_TRY(checkStream(stream_, path_));

  std::vector<std::uint32_t> maps(patches.size(), 0);  // of each patch
  for (lod::draw::NodeShadowMap& map : own_.maps)
    for (std::uint32_t& place : map.plan.receivers) ++maps[place = own[place]];
  for (const std::uint32_t place : shared) ++maps[place];
  own_.maps.emplace_back();
  for (std::uint32_t i = 0; i < patches.size(); ++i)
    if (maps[i] == 0) lit.push_back(i);

  maps_.clear();
  const auto add = [&](const lod::draw::NodeShadowMap& map, std::size_t slot, std::span<const std::uint32_t> places) {
    Map& added = maps_.emplace_back(Map{&map, slot, {}});
    for (const std::uint32_t place : places) {
      const lod::patch::Patch& patch = hierarchy.patches[patches[place]];
      const float reach = lod::draw::shadowReach(patch.box, patch.own_error, map.casters, stream_.nodes());
      added.receivers.push_back({patches[place], reach, maps[place] > 1});
    }
  };
  for (const lod::draw::NodeShadowMap& map : std::span(own_.maps).first(own_.maps.size() - 1))
    add(map, kOwnSlot, map.plan.receivers);
  if (!shared.empty()) {
    const SceneMap& scene = sceneMap(level);
    add(*scene.map, scene.slot, shared);
  }
  add(own_.maps.back(), kEmptySlot, lit);
  return {};
}

base::Result<void> PatchShadows::drawMap(std::size_t map) {
  const lod::draw::NodeShadowMap& drawn = *maps_[map].map;
  // The view's own maps take turns in one texture. Software GL keeps textures that were given up until all that was
  // drawn with them is done.
  if (maps_[map].slot == kOwnSlot) glFinish();
  const std::size_t slot = drawn.casters.empty() ? kEmptySlot : maps_[map].slot;
  return shadow_map_->draw({drawn.plan.camera, own_.light, drawn.plan.region, drawn.plan.slice}, drawn.casters, slot);
}

}  // namespace server
