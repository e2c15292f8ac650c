#include "server/render/patch_shadows.h"

#include <algorithm>
#include <cmath>
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
  made->shadow_map_->setKeptBytes(kStreamedGpuBytes);
  return made;
}

std::uint64_t PatchShadows::memoryFor(const base::Light& light, std::uint64_t triangles) {
  if (!light.hasShadows()) return 0;
  // A caster takes 12 bytes a triangle and about as much again for its positions, here and on the GPU.
  constexpr std::uint64_t kBytesPerTriangle = 40, kBytesPerTexel = 4;
  const bool is_soft = light.mode == base::LightMode::kSoftShadows;
  const std::uint64_t side = is_soft ? lod::draw::kSoftTexels : lod::draw::kHardTexels;
  const std::uint64_t layers = is_soft ? lod::draw::kMaxLightLayers : 1;
  // With llvmpipe a bake of 144 faces of a statue, whose maps are up to that large, was seen to take 1.9 GB.
  constexpr std::uint64_t kMapsHeld = 7;
  const std::uint64_t casters = std::min(triangles, (kStreamedDecodedBytes + kStreamedGpuBytes) / kBytesPerTriangle);
  return kBytesPerTriangle * casters + kMapsHeld * kBytesPerTexel * layers * side * side;
}

base::Result<void> PatchShadows::plan(const lod::hlod::TraverseRequest& view, const lod::patch::Hierarchy& hierarchy,
                                      std::span<const std::uint32_t> patches) {
  // Only the nodes' casters are of use. The root's picture stands for all, as a view must have some.
  lod::hlod::TraverseRequest coarsest = view;
  coarsest.tolerance = std::numeric_limits<float>::infinity();
  std::vector<lod::hlod::DrawnNode> root;
  stream_.update(coarsest, root);

  std::vector<lod::hlod::ShadowReceiver> boxes;
  for (const std::uint32_t patch : patches)
    boxes.push_back({hierarchy.patches[patch].box, levelOf(view.camera, hierarchy.patches[patch].bounds)});
  lod::hlod::TraverseRequest shadowed = view;
  shadowed.tolerance = view.tolerance > 0.0F ? std::max(view.tolerance, kPixelOff) : kHalfPixelOff;
  // A finder remembers maps, and a picture must not depend on those that were drawn before.
  shadows_ = lod::draw::NodeShadowFinder().find(stream_, boxes, shadowed, light_);
  LUMIGRID_TRY(checkStream(stream_, path_));

  std::vector<std::uint32_t> maps(patches.size(), 0);  // of each patch
  for (const lod::draw::NodeShadowMap& map : shadows_.maps)
    for (const std::uint32_t place : map.plan.receivers) ++maps[place];
  lod::draw::NodeShadowMap& lit = shadows_.maps.emplace_back();
  for (std::uint32_t i = 0; i < patches.size(); ++i)
    if (maps[i] == 0) lit.plan.receivers.push_back(i);

  receivers_.clear();
  for (const lod::draw::NodeShadowMap& map : shadows_.maps) {
    std::vector<Receiver>& receivers = receivers_.emplace_back();
    for (const std::uint32_t place : map.plan.receivers) {
      const lod::patch::Patch& patch = hierarchy.patches[patches[place]];
      const float reach = lod::draw::shadowReach(patch.box, patch.own_error, map.casters, shadows_.nodes);
      receivers.push_back({patches[place], reach, maps[place] > 1});
    }
  }
  return {};
}

base::Result<void> PatchShadows::drawMap(std::size_t map) {
  const lod::draw::NodeShadowMap& drawn = shadows_.maps[map];
  // All maps take turns in one texture, but for the empty one, for which it would shrink. Software GL keeps textures
  // that were given up until all that was drawn with them is done.
  glFinish();
  const std::size_t slot = drawn.casters.empty() ? 1 : 0;
  return shadow_map_->draw({drawn.plan.camera, shadows_.light, drawn.plan.region, drawn.plan.slice}, drawn.casters,
                           slot);
}

}  // namespace server
