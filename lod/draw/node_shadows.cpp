#include "lod/draw/node_shadows.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::draw {
namespace {

/// Eight slices show a ground up to 5 km from an eye at a man's height (docs/decisions/shadow-layers.md). A choice.
constexpr std::size_t kMaxMaps = 8;

/// The layers of a soft shadow together take the memory of few large maps, and their texels lie between each other's.
/// A shift by a pixel is not seen in a penumbra.
hlod::ShadowRequest requestFor(const hlod::TraverseRequest& view, const NodeLight& light) {
  hlod::ShadowRequest request;
  request.view = view;
  request.light = light.light;
  request.room = light.room;
  request.max_maps = kMaxMaps;
  const bool is_soft = light.light.size > 0.0F;
  request.texel_px = light.coarser * (is_soft ? 1.0F : 0.5F);
  request.max_texels = std::min(is_soft ? kSoftTexels : kHardTexels, light.max_texels);
  return request;
}

NodeShadowMap withCasters(hlod::Stream& stream, hlod::ShadowMapPlan plan) {
  std::vector<std::shared_ptr<const hlod::CasterPicture>> casters;
  stream.updateCasters(plan.casters, casters);
  NodeShadowMap map{std::move(plan), {}};
  for (auto& caster : casters) map.casters.push_back({std::move(caster)});
  return map;
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
  NodeShadows shadows{light.light, stream.nodes(), {}, light.kept_bytes};
  std::vector<hlod::LightRequest> lights;
  for (hlod::ShadowMapPlan& plan : planner_.plan(stream.nodes(), receivers, requestFor(request, light))) {
    lights.push_back({plan.camera, plan.receiver_error});
    shadows.maps.push_back(withCasters(stream, std::move(plan)));
  }
  stream.expectLights(std::move(lights));
  return shadows;
}

std::optional<NodeShadowMap> findSceneShadows(hlod::Stream& stream, const hlod::TraverseRequest& request,
                                              double pixels_per_unit, const NodeLight& light) {
  auto plan = hlod::planSceneShadowMap(stream.nodes(), pixels_per_unit, requestFor(request, light));
  if (!plan) return std::nullopt;
  return withCasters(stream, std::move(*plan));
}

std::uint32_t shadowTexelsFor(std::uint64_t bytes, bool soft) {
  constexpr std::uint64_t kBytesPerTexel = 4;
  const std::uint64_t layers = soft ? kMaxLightLayers : 1;
  const double side = std::sqrt(static_cast<double>(bytes / (kBytesPerTexel * layers)));
  return static_cast<std::uint32_t>(std::clamp(side, 1.0, 65536.0));
}

}  // namespace lod::draw
