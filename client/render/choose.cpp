#include "client/render/choose.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace client {
namespace {

/// Weighs a box's first image against further ones: gain = quality / (kSaturation + quality so far). Measured:
/// docs/lumigraph-tuning.md.
constexpr float kSaturation = 0.3F;
constexpr float kSameDirection =
    1.0F - 1e-6F;  ///< cosine: corners within 1.4 mrad, less than a pixel of a 90° face of 1024

glm::vec3 directionThrough(const glm::mat4& scene_from_clip, const glm::vec3& eye, float x, float y) {
  const glm::vec4 p = scene_from_clip * glm::vec4(x, y, 1.0F, 1.0F);
  return glm::normalize(glm::vec3(p) / p.w - eye);
}

/// Whether side a of one sample lies on side b of another: their corners coincide, in either order.
bool sidesCoincide(const SampleGeometry& one, int a, const SampleGeometry& other, int b) {
  const auto corner = [](const SampleGeometry& s, int i) { return s.corners[static_cast<std::size_t>(i & 3)]; };
  const auto same = [](const glm::vec3& u, const glm::vec3& v) { return glm::dot(u, v) > kSameDirection; };
  return (same(corner(one, a), corner(other, b)) && same(corner(one, a + 1), corner(other, b + 1))) ||
         (same(corner(one, a), corner(other, b + 1)) && same(corner(one, a + 1), corner(other, b)));
}

bool sameCentre(const SampleGeometry& a, const SampleGeometry& b) {
  const float scale = std::max({std::abs(a.eye.x), std::abs(a.eye.y), std::abs(a.eye.z), 1e-6F});
  return glm::length(a.eye - b.eye) <= 1e-5F * scale;
}

/// Component of borderFloors for each side, in the order of the corners: bottom, right, top, left.
constexpr std::array<int, 4> kFloorOfSide{2, 1, 3, 0};

}  // namespace

SampleGeometry::SampleGeometry(const base::Camera& camera)
    : clip_from_scene(camera.clipFromScene()),
      eye(camera.eye),
      pixels_per_unit_at_one(camera.pixelsPerUnitAtOne()),
      frustum(clip_from_scene) {
  const glm::mat4 scene_from_clip = glm::inverse(clip_from_scene);
  corners = {directionThrough(scene_from_clip, eye, -1, -1), directionThrough(scene_from_clip, eye, 1, -1),
             directionThrough(scene_from_clip, eye, 1, 1), directionThrough(scene_from_clip, eye, -1, 1)};
}

float sampleWeight(const glm::vec3& to_view, const glm::vec3& to_sample, float ratio, float error_px,
                   const BlendTuning& tuning) {
  const float angle = glm::length(glm::normalize(to_view) - glm::normalize(to_sample));
  const float blur = 1.0F / std::min(1.0F, ratio);
  const float shift = tuning.shift * error_px * angle;
  return std::pow(blur * blur + shift * shift, -0.5F * tuning.resolution_power) *
         std::pow(angle + tuning.angle_floor, -tuning.angle_power);
}

std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, std::span<const ProxyError> errors,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning) {
  // quality[s * boxes + b] is the weight of sample s in box b as a share of the best sample's there; sizes[b] is the
  // box's size on the screen.
  const std::size_t count = boxes.size();
  std::vector<float> quality(samples.size() * count, 0.0F);
  std::vector<float> sizes(count);
  for (std::size_t b = 0; b < count; ++b) {
    const glm::vec3 center = boxes[b].center();
    const float radius = 0.5F * boxes[b].diagonal() + 1e-20F;
    const glm::vec3 to_view = view.towardsViewer(center);
    const float distance = view.orthographic() ? 1.0F : std::max(glm::length(to_view), radius);
    const float error_px = errors[b].shape * view.pixelsPerUnitAtOne() / distance;
    float best = 0.0F;
    for (std::size_t s = 0; s < samples.size(); ++s) {
      if (!samples[s]->frustum.mayOverlap(boxes[b])) continue;
      const float sample_distance = std::max(glm::length(center - samples[s]->eye), radius);
      const float ratio = samples[s]->pixels_per_unit_at_one / sample_distance / (view.pixelsPerUnitAtOne() / distance);
      const float weight = sampleWeight(to_view, samples[s]->eye - center, ratio, error_px, tuning);
      if (!std::isfinite(weight)) continue;  // from an eye in the box's middle there is no direction
      quality[s * count + b] = weight;
      best = std::max(best, weight);
    }
    const float size_on_screen = radius / distance * (radius / distance);
    if (best > 0.0F)
      for (std::size_t s = 0; s < samples.size(); ++s) quality[s * count + b] /= best;
    sizes[b] = size_on_screen;
  }

  // Choose greedily the sample that adds most, with diminishing returns for boxes that have samples already.
  std::vector<std::size_t> chosen;
  std::vector<float> had(count, 0.0F);
  std::vector<char> taken(samples.size(), 0);
  while (chosen.size() < limit) {
    float best_gain = 0.0F;
    std::size_t best = samples.size();
    for (std::size_t s = 0; s < samples.size(); ++s) {
      if (taken[s] != 0) continue;
      float gain = 0.0F;
      for (std::size_t b = 0; b < count; ++b) gain += sizes[b] * quality[s * count + b] / (kSaturation + had[b]);
      if (gain > best_gain) best_gain = gain, best = s;
    }
    if (best == samples.size()) break;
    taken[best] = 1;
    chosen.push_back(best);
    for (std::size_t b = 0; b < count; ++b) had[b] += quality[best * count + b];
  }
  return chosen;
}

std::vector<glm::vec4> borderFloors(std::span<const SampleGeometry* const> samples, std::span<const float> fades) {
  std::vector<glm::vec4> floors(samples.size(), glm::vec4(0.0F));
  for (std::size_t i = 0; i < samples.size(); ++i)
    for (std::size_t j = 0; j < samples.size(); ++j) {
      if (i == j || fades[i] <= 0.0F || !sameCentre(*samples[i], *samples[j])) continue;
      for (int a = 0; a < 4; ++a)
        for (int b = 0; b < 4; ++b) {
          if (!sidesCoincide(*samples[i], a, *samples[j], b)) continue;
          float& floor = floors[i][kFloorOfSide[static_cast<std::size_t>(a)]];
          floor = std::max(floor, std::min(1.0F, fades[j] / fades[i]));
        }
    }
  return floors;
}

}  // namespace client
