#include "client/viewer/expected_use.h"

#include <algorithm>
#include <array>

#include "base/geometry.h"
#include "client/render/choose.h"

namespace client {
namespace {

/// A patch is represented by its centre and by six points half-way to its sphere, so that a patch that fills the screen
/// has more than one point.
constexpr std::array<glm::vec3, 7> kPatchPoints{glm::vec3(0.0F, 0.0F, 0.0F),  glm::vec3(0.5F, 0.0F, 0.0F),
                                                glm::vec3(-0.5F, 0.0F, 0.0F), glm::vec3(0.0F, 0.5F, 0.0F),
                                                glm::vec3(0.0F, -0.5F, 0.0F), glm::vec3(0.0F, 0.0F, 0.5F),
                                                glm::vec3(0.0F, 0.0F, -0.5F)};

bool inClipVolume(const glm::vec4& clip) {
  return clip.w > 0.0F && std::abs(clip.x) <= clip.w && std::abs(clip.y) <= clip.w;
}

/// Returns the blend's weight of one image at one point (client/render/choose.h). The proxy's error is taken as 0,
/// since nothing has been drawn yet.
float weightAt(const glm::vec3& point, const base::Camera& view, const base::Camera& sample) {
  const glm::vec3 to_view = view.towardsViewer(point);
  const glm::vec3 to_sample = sample.towardsViewer(point);
  if (to_view == glm::vec3(0.0F) || to_sample == glm::vec3(0.0F)) return 0.0F;
  return sampleWeight(to_view, to_sample, sample.pixelsPerUnit(point) / view.pixelsPerUnit(point), 0.0F, BlendTuning{});
}

}  // namespace

std::vector<glm::vec3> anchorsInView(const lod::patch::Hierarchy& hierarchy, std::span<const std::uint32_t> cut,
                                     const base::Camera& view) {
  // Collect all points of the cut that are in view.
  const glm::mat4 clip_from_scene = view.clipFromScene();
  std::vector<glm::vec3> in_view;
  for (std::uint32_t patch : cut) {
    const base::Sphere& bounds = hierarchy.patches[patch].bounds;
    for (const glm::vec3& offset : kPatchPoints) {
      const glm::vec3 point = bounds.center + bounds.radius * offset;
      if (inClipVolume(clip_from_scene * glm::vec4(point, 1.0F))) in_view.push_back(point);
    }
  }

  // Keep an even choice of them.
  if (in_view.size() <= kMaxAnchors) return in_view;
  std::vector<glm::vec3> anchors(kMaxAnchors);
  for (std::size_t i = 0; i < kMaxAnchors; ++i) anchors[i] = in_view[i * in_view.size() / kMaxAnchors];
  return anchors;
}

std::vector<float> expectedUse(std::span<const glm::vec3> anchors, const base::Camera& view,
                               std::span<const base::Camera* const> samples,
                               const std::function<bool(const glm::vec3& eye, std::size_t anchor)>& is_seen_from) {
  std::vector<glm::mat4> clip_from_scene;
  clip_from_scene.reserve(samples.size());
  for (const base::Camera* sample : samples) clip_from_scene.push_back(sample->clipFromScene());

  std::vector<float> use(samples.size(), 0.0F);
  std::vector<float> weights(samples.size());
  for (std::size_t a = 0; a < anchors.size(); ++a) {
    const glm::vec3& anchor = anchors[a];
    float sum = 0.0F;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const bool seen = inClipVolume(clip_from_scene[i] * glm::vec4(anchor, 1.0F)) &&
                        (!is_seen_from || is_seen_from(samples[i]->eye, a));
      weights[i] = seen ? weightAt(anchor, view, *samples[i]) : 0.0F;
      sum += weights[i];
    }
    if (sum <= 0.0F) continue;
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (weights[i] > 0.0F) use[i] += weights[i] / (sum * static_cast<float>(anchors.size()));
  }
  return use;
}

}  // namespace client
