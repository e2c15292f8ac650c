#include "client/render/sample_geometry.h"

#include <algorithm>
#include <numeric>

namespace client {
namespace {

/// A picture counts as finer than another from this ratio of their densities on; those of tiles differ by powers of 2.
constexpr float kFiner = 1.5F;
constexpr float kRounding = 1e-3F;  ///< share of a core's half width

glm::vec3 directionThrough(const glm::mat4& scene_from_clip, const glm::vec3& eye, float x, float y) {
  const glm::vec4 p = scene_from_clip * glm::vec4(x, y, 1.0F, 1.0F);
  return glm::normalize(glm::vec3(p) / p.w - eye);
}

/// Returns the matrix for which clip coordinates −1 … 1 are the core.
glm::mat4 coreFromScene(const glm::mat4& clip_from_scene, float core) {
  if (core == 1.0F) return clip_from_scene;
  glm::mat4 scale(1.0F);
  scale[0][0] = scale[1][1] = 1.0F / core;
  return scale * clip_from_scene;
}

bool isFiner(const SampleGeometry& fine, const SampleGeometry& coarse) {
  return fine.pixels_per_unit_at_one >= kFiner * coarse.pixels_per_unit_at_one;
}

bool liesWithin(const SampleGeometry& fine, const SampleGeometry& coarse) {
  return std::all_of(fine.corners.begin(), fine.corners.end(), [&](const glm::vec3& corner) {
    const glm::vec3 place = coarse.placeInCore(corner);
    const float reach = (1.0F + kRounding) * place.z;
    return place.z > 0.0F && std::abs(place.x) <= reach && std::abs(place.y) <= reach;
  });
}

}  // namespace

SampleGeometry::SampleGeometry(const base::Camera& camera, float core_share)
    : clip_from_scene(camera.clipFromScene()),
      eye(camera.eye),
      pixels_per_unit_at_one(camera.pixelsPerUnitAtOne()),
      core(core_share),
      frustum(coreFromScene(clip_from_scene, core_share)) {
  const glm::mat4 scene_from_clip = glm::inverse(clip_from_scene);
  corners = {directionThrough(scene_from_clip, eye, -core, -core), directionThrough(scene_from_clip, eye, core, -core),
             directionThrough(scene_from_clip, eye, core, core), directionThrough(scene_from_clip, eye, -core, core)};
}

glm::vec3 SampleGeometry::placeInCore(const glm::vec3& direction) const {
  const glm::vec4 clip = clip_from_scene * glm::vec4(direction, 0.0F);
  return {clip.x / core, clip.y / core, clip.w};
}

bool sameCentre(const SampleGeometry& a, const SampleGeometry& b) {
  const glm::vec3 apart = a.eye - b.eye;
  const float reach = 1e-5F * std::max({std::abs(a.eye.x), std::abs(a.eye.y), std::abs(a.eye.z), 1e-6F});
  return glm::dot(apart, apart) <= reach * reach;
}

SampleNesting nestingOf(std::span<const SampleGeometry* const> samples) {
  SampleNesting nesting{std::vector<std::vector<std::uint32_t>>(samples.size()),
                        std::vector<std::vector<std::uint32_t>>(samples.size())};
  for (std::uint32_t i = 0; i < samples.size(); ++i)
    for (std::uint32_t j = 0; j < samples.size(); ++j) {
      if (!isFiner(*samples[i], *samples[j]) || !sameCentre(*samples[i], *samples[j])) continue;
      if (!liesWithin(*samples[i], *samples[j])) continue;
      nesting.coarser[i].push_back(j);
      nesting.finer[j].push_back(i);
    }
  return nesting;
}

std::vector<std::uint32_t> finestFirst(std::span<const SampleGeometry* const> samples, const SampleNesting& nesting,
                                       std::vector<std::uint32_t>* groups) {
  // A group is named after its first sample that lies in no other.
  std::vector<std::uint32_t> group(samples.size());
  for (std::uint32_t i = 0; i < samples.size(); ++i) {
    group[i] = i;
    for (const std::uint32_t j : nesting.coarser[i])
      if (nesting.coarser[j].empty()) group[i] = std::min(group[i] == i ? j : group[i], j);
  }
  std::vector<std::uint32_t> order(samples.size());
  std::iota(order.begin(), order.end(), 0U);
  // The stable sorts of the standard library would cost the page 1 kB.
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    if (group[a] != group[b]) return group[a] < group[b];
    const float detail_a = samples[a]->pixels_per_unit_at_one, detail_b = samples[b]->pixels_per_unit_at_one;
    return detail_a != detail_b ? detail_a > detail_b : a < b;
  });
  groups->clear();
  for (const std::uint32_t i : order) groups->push_back(group[i]);
  return order;
}

}  // namespace client
