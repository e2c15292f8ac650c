#include "client/render/choose.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace client {
namespace {

constexpr float kSameDirection = 1.0F - 1e-6F;  ///< cosine: corners within 1.4 mrad, under a pixel of a 90° face of 1024

glm::vec3 directionThrough(const glm::mat4& scene_from_clip, const glm::vec3& eye, float x, float y) {
  const glm::vec4 p = scene_from_clip * glm::vec4(x, y, 1.0F, 1.0F);
  return glm::normalize(glm::vec3(p) / p.w - eye);
}

/// Does side a of one sample lie on side b of another (their corners coincide, in either order)?
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

/// Sides in the order of the corners (bottom, right, top, left) to components of borderFloors.
constexpr std::array<int, 4> kFloorOfSide{2, 1, 3, 0};

float distanceTo(const base::Aabb& box, const glm::vec3& eye) { return glm::length(box.center() - eye); }

}  // namespace

SampleGeometry::SampleGeometry(const base::Camera& camera)
    : clip_from_scene(camera.clipFromScene()), eye(camera.eye), pixels_per_unit_at_one(camera.pixelsPerUnitAtOne()), frustum(clip_from_scene) {
  const glm::mat4 scene_from_clip = glm::inverse(clip_from_scene);
  corners = {directionThrough(scene_from_clip, eye, -1, -1), directionThrough(scene_from_clip, eye, 1, -1),
             directionThrough(scene_from_clip, eye, 1, 1), directionThrough(scene_from_clip, eye, -1, 1)};
}

float sampleWeight(const glm::vec3& point, const glm::vec3& view_eye, const glm::vec3& sample_eye, float view_density, float sample_density,
                   const BlendTuning& tuning) {
  const glm::vec3 to_view = glm::normalize(view_eye - point);
  const glm::vec3 to_sample = glm::normalize(sample_eye - point);
  const float angle = glm::length(to_view - to_sample);
  const float ratio = std::min(1.0F, sample_density / view_density);
  return std::pow(ratio, tuning.resolution_power) * std::pow(angle + tuning.angle_floor, -tuning.angle_power);
}

std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples, std::span<const base::Aabb> boxes,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning) {
  std::vector<float> votes(samples.size(), 0.0F);
  std::vector<float> weights(samples.size());
  for (const base::Aabb& box : boxes) {
    const glm::vec3 center = box.center();
    const float radius = 0.5F * box.diagonal();
    const float distance = std::max(distanceTo(box, view.eye), radius + 1e-20F);
    const float view_density = view.pixelsPerUnitAtOne() / distance;
    float sum = 0.0F;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      weights[i] = 0.0F;
      if (!samples[i]->frustum.mayOverlap(box)) continue;
      const float sample_density = samples[i]->pixels_per_unit_at_one / std::max(distanceTo(box, samples[i]->eye), radius + 1e-20F);
      weights[i] = sampleWeight(center, view.eye, samples[i]->eye, view_density, sample_density, tuning);
      if (!std::isfinite(weights[i])) weights[i] = 0.0F;  // an eye in the box's middle has no direction
      sum += weights[i];
    }
    const float size_on_screen = radius / distance * (radius / distance);
    if (sum > 0.0F)
      for (std::size_t i = 0; i < samples.size(); ++i) votes[i] += size_on_screen * weights[i] / sum;
  }

  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (votes[i] > 0.0F) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return votes[a] > votes[b]; });
  if (order.size() > limit) order.resize(limit);
  return order;
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
