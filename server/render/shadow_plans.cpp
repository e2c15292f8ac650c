#include "server/render/shadow_plans.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <utility>

#include "server/render/sample_target.h"

namespace server {
namespace {

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

/// Each map draws casters anew, so there are no more maps than it takes for texels of twice the wanted size. Edges of
/// shadows are off by half a texel.
std::vector<lod::hlod::ShadowMapPlan> planMaps(std::span<const lod::hlod::Node> nodes,
                                               const lod::hlod::TraverseRequest& view,
                                               std::span<const lod::hlod::ShadowReceiver> receivers,
                                               const lod::hlod::ShadowLight& light, Shadows shadows) {
  constexpr std::size_t kMaxMaps = 4;
  lod::hlod::ShadowRequest request;
  request.view = view;
  request.light = light;
  setFineness(request, shadows);
  for (request.max_maps = 1;; ++request.max_maps) {
    auto plans = lod::hlod::planShadowMaps(nodes, receivers, request);
    const bool is_fine = std::all_of(plans.begin(), plans.end(), [&](const lod::hlod::ShadowMapPlan& plan) {
      return plan.texel_px <= 2.0F * request.texel_px;
    });
    if (is_fine || request.max_maps == kMaxMaps) return plans;
  }
}

}  // namespace

ShadowOptions shadowsOf(const base::Light& light, const glm::dvec3& origin) {
  ShadowOptions options;
  if (!light.hasShadows()) return options;
  options.shadows = light.mode == base::LightMode::kSoftShadows ? Shadows::kSoft : Shadows::kHard;
  options.light.place = glm::vec4(glm::normalize(light.direction), 0.0F);
  options.light.size = static_cast<float>(light.size * std::numbers::pi / 180.0);
  if (!light.position) return options;
  options.light.place = glm::vec4(glm::vec3(*light.position - origin), 1.0F);
  options.light.size = static_cast<float>(light.size);
  return options;
}

base::Result<void> checkShadows(const ShadowOptions& options) {
  if (options.shadows != Shadows::kSoft || options.light.size > 0.0F) return {};
  return base::Error{base::ErrorCode::kInvalidInput, "render: soft shadows need a light of some size"};
}

lod::draw::NodeShadows planShadows(lod::hlod::Stream& stream, const lod::hlod::TraverseRequest& view,
                                   std::span<const lod::hlod::ShadowReceiver> receivers, const ShadowOptions& options,
                                   bool closed) {
  lod::draw::NodeShadows shadows{options.light, stream.nodes(), closed, {}};
  if (options.shadows == Shadows::kHard) shadows.light.size = 0.0F;
  for (lod::hlod::ShadowMapPlan& plan : planMaps(stream.nodes(), view, receivers, shadows.light, options.shadows)) {
    if (closed)
      std::erase_if(plan.casters, [&](std::uint32_t node) { return facesAway(stream.nodes()[node], shadows.light); });
    std::vector<std::shared_ptr<const lod::hlod::CasterPicture>> casters;
    stream.updateCasters(plan.casters, casters);
    lod::draw::NodeShadowMap& map = shadows.maps.emplace_back();
    map.plan = std::move(plan);
    for (auto& caster : casters) map.casters.push_back({std::move(caster)});
  }
  return shadows;
}

}  // namespace server
