#include "lod/draw/node_shadows.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::draw {
namespace {

/// Eight slices show a ground up to 5 km from an eye at a man's height (docs/decisions/shadow-layers.md). A choice.
constexpr std::size_t kMaxMaps = 8;

/// How fine shadow maps are. The layers of a soft shadow together take the memory of few large maps, and their texels
/// lie between each other's. What a pixel's width moves is not seen in a penumbra.
void setFineness(hlod::ShadowRequest& request, std::uint32_t max_texels) {
  const bool is_soft = request.light.size > 0.0F;
  request.texel_px = is_soft ? 1.0F : 0.5F;
  request.max_texels = std::min(is_soft ? kSoftTexels : kHardTexels, max_texels);
}

}  // namespace

NodeShadows NodeShadowFinder::find(hlod::Stream& stream, std::span<const hlod::DrawnNode> nodes,
                                   const hlod::TraverseRequest& request, const NodeLight& light) {
  std::vector<std::uint32_t> drawn;
  for (const hlod::DrawnNode& node : nodes) drawn.push_back(node.picture->node);
  return find(stream, hlod::receiversOf(stream.nodes(), drawn), request, light);
}

NodeShadows NodeShadowFinder::find(hlod::Stream& stream, std::span<const hlod::ShadowReceiver> receivers,
                                   const hlod::TraverseRequest& request, const NodeLight& light) {
  hlod::ShadowRequest wanted;
  wanted.view = request;
  wanted.light = light.light;
  wanted.room = light.room;
  wanted.max_maps = kMaxMaps;
  setFineness(wanted, light.max_texels);
  NodeShadows shadows{light.light, stream.nodes(), {}, light.kept_bytes};
  std::vector<hlod::LightRequest> lights;
  for (hlod::ShadowMapPlan& plan : planner_.plan(stream.nodes(), receivers, wanted)) {
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
