#include "lod/draw/node_shadows.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::draw {
namespace {

/// Seven slices of a view show a ground from one unit of length away up to 5000.
constexpr std::size_t kMaxMaps = 8;

/// How fine shadow maps are. The layers of a soft shadow together take the memory of few large maps, and their texels
/// lie between each other's. What a pixel's width moves is not seen in a penumbra.
void setFineness(hlod::ShadowRequest& request, std::uint32_t max_texels) {
  const bool is_soft = request.light.size > 0.0F;
  request.texel_px = is_soft ? 1.0F : 0.5F;
  request.max_texels = std::min(is_soft ? 2048U : 4096U, max_texels);
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

}  // namespace

NodeShadows NodeShadowFinder::find(hlod::Stream& stream, std::span<const hlod::DrawnNode> nodes,
                                   const hlod::TraverseRequest& request, const NodeLight& light) {
  hlod::ShadowRequest wanted;
  wanted.view = request;
  wanted.light = light.light;
  wanted.room = light.room;
  wanted.max_maps = kMaxMaps;
  setFineness(wanted, light.max_texels);
  std::vector<std::uint32_t> drawn;
  for (const hlod::DrawnNode& node : nodes) drawn.push_back(node.picture->node);
  NodeShadows shadows{light.light, stream.nodes(), light.closed, {}, light.kept_bytes};
  std::vector<hlod::LightRequest> lights;
  for (hlod::ShadowMapPlan& plan : planner_.plan(stream.nodes(), hlod::receiversOf(stream.nodes(), drawn), wanted)) {
    if (light.closed)
      std::erase_if(plan.casters, [&](std::uint32_t node) { return facesAway(stream.nodes()[node], shadows.light); });
    std::vector<std::shared_ptr<const hlod::CasterPicture>> casters;
    stream.updateCasters(plan.casters, casters);
    NodeShadowMap& map = shadows.maps.emplace_back();
    map.plan = std::move(plan);
    for (auto& caster : casters) map.casters.push_back({std::move(caster)});
    lights.push_back({map.plan.camera, map.plan.receiver_error});
  }
  stream.expectLights(std::move(lights));
  return shadows;
}

std::uint32_t shadowTexelsFor(std::uint64_t bytes, bool soft) {
  constexpr std::uint64_t kBytesPerTexel = 4;
  const std::uint64_t layers = soft ? kMaxLightLayers : 1;
  const double side = std::sqrt(static_cast<double>(bytes / (kBytesPerTexel * layers)));
  return static_cast<std::uint32_t>(std::clamp(side, 1.0, 65536.0));
}

}  // namespace lod::draw
