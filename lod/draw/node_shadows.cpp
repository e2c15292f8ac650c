#include "lod/draw/node_shadows.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::draw {
namespace {

/// How fine shadow maps are. The layers of a soft shadow together take the memory of few large maps, and their texels
/// lie between each other's. What a pixel's width moves is not seen in a penumbra.
void setFineness(hlod::ShadowRequest& request, std::uint32_t max_texels) {
  const bool is_soft = request.light.size > 0.0F;
  request.texel_px = is_soft ? 1.0F : 0.5F;
  request.max_texels = std::min(is_soft ? kSoftTexels : kHardTexels, max_texels);
}

/// Whether no part of the light sees the front of a triangle of the node.
bool facesAway(const hlod::Node& node, const hlod::ShadowLight& light) {
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
std::vector<hlod::ShadowMapPlan> planMaps(const hlod::Stream& stream, std::span<const hlod::ShadowReceiver> receivers,
                                          const hlod::TraverseRequest& request, const NodeLight& light) {
  constexpr std::size_t kMaxMaps = 4;
  hlod::ShadowRequest shadow;
  shadow.view = request;
  shadow.light = light.light;
  setFineness(shadow, light.max_texels);
  for (shadow.max_maps = 1;; ++shadow.max_maps) {
    auto plans = hlod::planShadowMaps(stream.nodes(), receivers, shadow);
    const bool is_fine = std::all_of(plans.begin(), plans.end(), [&](const hlod::ShadowMapPlan& plan) {
      return plan.texel_px <= 2.0F * shadow.texel_px;
    });
    if (is_fine || shadow.max_maps == kMaxMaps) return plans;
  }
}

}  // namespace

NodeShadows findNodeShadows(hlod::Stream& stream, std::span<const hlod::DrawnNode> nodes,
                            const hlod::TraverseRequest& request, const NodeLight& light) {
  std::vector<std::uint32_t> drawn;
  for (const hlod::DrawnNode& node : nodes) drawn.push_back(node.picture->node);
  return findShadows(stream, hlod::receiversOf(stream.nodes(), drawn), request, light);
}

NodeShadows findShadows(hlod::Stream& stream, std::span<const hlod::ShadowReceiver> receivers,
                        const hlod::TraverseRequest& request, const NodeLight& light) {
  NodeShadows shadows{light.light, stream.nodes(), light.closed, {}};
  for (hlod::ShadowMapPlan& plan : planMaps(stream, receivers, request, light)) {
    if (light.closed)
      std::erase_if(plan.casters, [&](std::uint32_t node) { return facesAway(stream.nodes()[node], shadows.light); });
    std::vector<std::shared_ptr<const hlod::CasterPicture>> casters;
    stream.updateCasters(plan.casters, casters);
    NodeShadowMap& map = shadows.maps.emplace_back();
    map.plan = std::move(plan);
    for (auto& caster : casters) map.casters.push_back({std::move(caster)});
  }
  return shadows;
}

std::uint32_t shadowTexelsFor(std::uint64_t bytes, bool soft) {
  constexpr std::uint64_t kBytesPerTexel = 4;
  const std::uint64_t layers = soft ? kMaxLightLayers : 1;
  const double side = std::sqrt(static_cast<double>(bytes / (kBytesPerTexel * layers)));
  return static_cast<std::uint32_t>(std::clamp(side, 1.0, 65536.0));
}

}  // namespace lod::draw
