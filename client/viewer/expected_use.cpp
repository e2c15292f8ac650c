#include "client/viewer/expected_use.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

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

/// The anchors' coordinates one beside the other, so that many are tested at a time.
class AnchorColumns {
 public:
  explicit AnchorColumns(std::span<const glm::vec3> anchors) {
    for (const glm::vec3& anchor : anchors) x_.push_back(anchor.x), y_.push_back(anchor.y), z_.push_back(anchor.z);
  }
  /// Sets 1 for anchors in the clip volume, 0 for others.
  void findIn(const glm::mat4& clip_from_scene, std::span<std::uint8_t> found) const {
    const glm::mat4 rows = glm::transpose(clip_from_scene);
    const glm::vec4 &x = rows[0], &y = rows[1], &w = rows[3];
    for (std::size_t i = 0; i < x_.size(); ++i) {
      const float clip_x = x.x * x_[i] + x.y * y_[i] + x.z * z_[i] + x.w;
      const float clip_y = y.x * x_[i] + y.y * y_[i] + y.z * z_[i] + y.w;
      const float clip_w = w.x * x_[i] + w.y * y_[i] + w.z * z_[i] + w.w;
      constexpr float kLeast = 1e-30F;  // what lies at the eye is not in view
      found[i] = std::max({std::abs(clip_x), std::abs(clip_y), kLeast}) <= clip_w ? 1 : 0;
    }
  }

 private:
  std::vector<float> x_, y_, z_;
};

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
  const AnchorColumns columns(anchors);
  struct Seen {
    std::uint32_t anchor;
    float weight;
  };
  std::vector<Seen> all;          // by sample
  std::vector<std::size_t> ends;  // in `all`, of each sample's
  std::vector<float> sums(anchors.size(), 0.0F);
  std::vector<std::uint8_t> in_view(anchors.size());
  for (const base::Camera* sample : samples) {
    columns.findIn(sample->clipFromScene(), in_view);
    for (std::uint32_t a = 0; a < anchors.size(); ++a) {
      if (in_view[a] == 0 || (is_seen_from && !is_seen_from(sample->eye, a))) continue;
      const float weight = weightAt(anchors[a], view, *sample);
      sums[a] += weight;
      if (weight > 0.0F) all.push_back({a, weight});
    }
    ends.push_back(all.size());
  }

  std::vector<float> use(samples.size(), 0.0F);
  std::size_t next = 0;
  for (std::size_t i = 0; i < samples.size(); ++i)
    for (; next < ends[i]; ++next) {
      const Seen& seen = all[next];
      if (sums[seen.anchor] > 0.0F) use[i] += seen.weight / (sums[seen.anchor] * static_cast<float>(anchors.size()));
    }
  return use;
}

}  // namespace client
