#include "server/render/hlod_scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/render/streamed_scene.h"

namespace server {
namespace {

/// By so many pixels tiles overlap: points reach as far beyond their centres, and lines beyond their ends, as a node's
/// error, half a pixel at least, and some drivers discard points whose centre lies outside the target.
int tileBorder(float tolerance) {
  constexpr float kMaxBorder = 64.0F;
  return 1 + static_cast<int>(std::ceil(std::min(tolerance, kMaxBorder)));
}

/// How fine shadow maps are. The layers of a soft shadow together take the memory of few large maps, and their texels
/// lie between each other's. What a pixel's width moves is not seen in a penumbra.
void setFineness(lod::hlod::ShadowRequest& request, Shadows shadows) {
  const bool is_soft = shadows == Shadows::kSoft;
  request.texel_px = is_soft ? 1.0F : 0.5F;
  request.max_texels = std::min(is_soft ? 2048U : 4096U, static_cast<std::uint32_t>(SampleTarget::maxSide()));
}

/// Whether no part of the light sees the front of a triangle of the node.
bool facesAway(const lod::hlod::Node& node, const lod::hlod::ShadowLight& light) {
  constexpr float kFarAway = 1e4F;  // in radii
  base::Sphere bounds{node.box.center(), 0.5F * glm::length(node.box.size())};
  const glm::vec3 place(light.place);
  if (light.place.w > 0.0F) {
    bounds.radius += 0.5F * light.size;
    return base::facesAway(node.cone, bounds, place);
  }
  const float distance = kFarAway * std::max(bounds.radius, 1e-20F);
  bounds.radius += distance * std::tan(0.5F * light.size);
  return base::facesAway(node.cone, bounds, bounds.center + distance * place);
}

base::Result<void> checkLight(const HlodOptions& options) {
  if (options.shadows != Shadows::kSoft || options.light.size > 0.0F) return {};
  return base::Error{base::ErrorCode::kInvalidInput, "render: soft shadows need a light of some size"};
}

}  // namespace

HlodScene::HlodScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file, const base::Scene& scene)
    : path_(std::move(path)),
      stream_(file, wholeFile<lod::hlod::StreamOptions>()),
      shading_{scene.light.mode == base::LightMode::kUnlit, scene.light.direction},
      closed_(scene.border && scene.border->open_edges == 0) {}

base::Result<std::unique_ptr<HlodScene>> HlodScene::create(const std::string& directory, const base::Scene& scene) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, openStreamedFile(directory, scene, base::kHlodMethod));
  std::unique_ptr<HlodScene> made(new HlodScene(file.path, file.bytes, scene));
  LUMIGRID_TRY(checkStream(made->stream_, file.path));
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::NodeRenderer::create(kStreamedGpuBytes));
  LUMIGRID_ASSIGN_OR_RETURN(made->tiles_, TiledPicture::create());
  return made;
}

/// Each map draws casters anew, so there are no more maps than it takes for texels of twice the wanted size. Edges of
/// shadows are off by half a texel.
std::vector<lod::hlod::ShadowMapPlan> HlodScene::planMaps(const lod::hlod::TraverseRequest& request,
                                                          const HlodOptions& options) const {
  constexpr std::size_t kMaxMaps = 4;
  lod::hlod::ShadowRequest shadow;
  shadow.view = request;
  shadow.light = shadows_.light;
  setFineness(shadow, options.shadows);
  std::vector<std::uint32_t> receivers;
  for (const lod::hlod::DrawnNode& node : nodes_) receivers.push_back(node.picture->node);
  for (shadow.max_maps = 1;; ++shadow.max_maps) {
    auto plans = lod::hlod::planShadowMaps(stream_.nodes(), receivers, shadow);
    const bool is_fine = std::all_of(plans.begin(), plans.end(), [&](const lod::hlod::ShadowMapPlan& plan) {
      return plan.texel_px <= 2.0F * shadow.texel_px;
    });
    if (is_fine || shadow.max_maps == kMaxMaps) return plans;
  }
}

/// Finds the maps of the shadows on nodes_, and what throws them.
base::Result<void> HlodScene::planShadows(const lod::hlod::TraverseRequest& request, const HlodOptions& options) {
  shadows_ = {options.light, stream_.nodes(), closed_, {}};
  if (options.shadows == Shadows::kHard) shadows_.light.size = 0.0F;
  for (lod::hlod::ShadowMapPlan& plan : planMaps(request, options)) {
    if (closed_)
      std::erase_if(plan.casters, [&](std::uint32_t node) { return facesAway(stream_.nodes()[node], shadows_.light); });
    std::vector<std::shared_ptr<const lod::hlod::CasterPicture>> casters;
    stream_.updateCasters(plan.casters, casters);
    lod::draw::NodeShadowMap& map = shadows_.maps.emplace_back();
    map.plan = std::move(plan);
    for (auto& caster : casters) map.casters.push_back({std::move(caster)});
  }
  return checkStream(stream_, path_);
}

base::Result<void> HlodScene::drawTile(const lod::hlod::TraverseRequest& request, const SampleTarget& target,
                                       const HlodOptions& options, HlodPicture& picture) {
  stream_.update(request, nodes_);
  LUMIGRID_TRY(checkStream(stream_, path_));
  const bool has_shadows = options.shadows != Shadows::kNone;
  if (has_shadows) LUMIGRID_TRY(planShadows(request, options));
  lod::draw::NodeView view;
  view.camera = *request.tile;
  view.shading = shading_;
  const int samples = options.supersampling;
  LUMIGRID_ASSIGN_OR_RETURN(
      const auto count,
      renderer_->draw(nodes_, view, {target.framebuffer(), view.camera.width * samples, view.camera.height * samples},
                      has_shadows ? &shadows_ : nullptr));
  picture.count.triangles += count.triangles;
  picture.count.points += count.points;
  picture.count.lines += count.lines;
  return {};
}

base::Result<HlodPicture> HlodScene::render(const base::Camera& camera, const HlodOptions& options) {
  LUMIGRID_TRY(checkTolerance(options.tolerance));
  LUMIGRID_TRY(checkLight(options));
  HlodPicture picture;
  // A place that lies in several tiles is shown by the same node in all of them.
  lod::hlod::TraverseRequest request;
  request.camera = camera;
  request.tolerance = options.tolerance;
  LUMIGRID_ASSIGN_OR_RETURN(picture.rgba, tiles_->draw(
                                              camera, options,
                                              [&](const base::Camera& tile, const SampleTarget& target) {
                                                request.tile = tile;
                                                return drawTile(request, target, options, picture);
                                              },
                                              tileBorder(options.tolerance)));
  return picture;
}

}  // namespace server
