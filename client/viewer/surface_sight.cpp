#include "client/viewer/surface_sight.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "lod/patch/proxy_sight.h"
#include "lod/patch/traverse.h"
#include "plan/coarse_sight.h"
#include "plan/point_choice.h"

namespace client {
namespace {

constexpr std::uint64_t kTriangles = 20'000;  ///< of the coarse patches: 1.5 MB
constexpr double kGrowth = 1.25;              ///< as much finer the next ones are at least
/// Radians of turning, and steps of the eye over the distance to what is nearest, that move places of a picture by less
/// than half of what lies between two rays.
constexpr float kNearlySame = 0.015F;
/// Rays across the picture, and up. A tile shows a twentieth of a picture or so.
constexpr int kColumns = 24, kRows = 14;

class LinesOfSight final : public SurfaceSight {
 public:
  void renew(Session& session) override;
  bool lookFrom(const base::Camera& camera, bool roughly) override;
  const VisibleSurface& surface() const override { return surface_; }

 private:
  /// Keeps what is known of an eye, by place: 0 nothing, 1 seen, 2 hidden.
  struct Eye {
    glm::vec3 place;
    std::vector<std::uint8_t> verdicts;
  };

  bool isBeside(const base::Camera& camera) const;
  bool isSeenFrom(const glm::vec3& eye, std::size_t place);
  bool findOut(const glm::vec3& eye, std::size_t place) const;

  std::optional<lod::patch::ProxySight> sight_;
  std::uint64_t groups_ = 0;  ///< that had come at the last renew()
  base::Camera camera_;       ///< of the last look
  std::vector<plan::SurfaceSample> met_;
  float nearest_ = 0.0F;      ///< distance of those from the eye
  std::size_t last_eye_ = 0;  ///< in eyes_, that was asked for last
  VisibleSurface surface_;
  std::vector<Eye> eyes_;  ///< of the last look: a few dozen, since all images of a point have one
};

void LinesOfSight::renew(Session& session) {
  const std::uint64_t groups = session.stats().groups_received;
  const auto finer = sight_ ? static_cast<std::uint64_t>(kGrowth * static_cast<double>(sight_->triangleCount())) : 0;
  if (groups == groups_ || finer > kTriangles) return;
  groups_ = groups;
  lod::patch::CutRequest coarse;  // a parallel projection, in which errors count alike everywhere
  coarse.tolerance_px = 0.0F;
  coarse.cull = false;
  coarse.max_triangles = kTriangles;
  const lod::patch::Cut cut =
      lod::patch::selectCut(session.hierarchy(), coarse, [&](std::uint32_t group) { return session.hasGroup(group); });
  if (cut.triangles < finer) return;
  auto made = plan::makeCoarseSight(session.hierarchy(), cut.expanded,
                                    [&](std::uint32_t group) { return base::ByteView(*session.block(group)); });
  if (!made) return;  // what is damaged is named where it is drawn
  sight_ = std::move(*made);
  camera_ = {};
}

bool LinesOfSight::lookFrom(const base::Camera& camera, bool roughly) {
  if (!sight_ || camera.orthographic()) return false;  // rays of a perspective are cast
  if (!base::sameCamera(camera, camera_) && !(roughly && isBeside(camera))) {
    camera_ = camera;
    met_ = plan::sampleVisibleSurface(*sight_, camera, kColumns, kRows);
    eyes_.clear();
    surface_.places.clear();
    nearest_ = std::numeric_limits<float>::max();
    for (const plan::SurfaceSample& sample : met_) {
      surface_.places.push_back(sample.position);
      nearest_ = std::min(nearest_, glm::length(sample.position - camera.eye));
    }
    surface_.is_seen_from = [this](const glm::vec3& eye, std::size_t place) { return isSeenFrom(eye, place); };
  }
  return !surface_.places.empty();
}

/// Whether the view shows the places of the last look nearly where that did.
bool LinesOfSight::isBeside(const base::Camera& camera) const {
  if (met_.empty() || camera.section != camera_.section || camera.orthographic() != camera_.orthographic())
    return false;
  // The planes before and behind all are fitted to each view.
  const auto shape = [](const base::Camera& c) {
    const glm::mat4& p = c.clip_from_eye;
    return glm::vec4(p[0][0], p[1][1], p[2][0], p[2][1]);
  };
  if (shape(camera) != shape(camera_)) return false;
  const glm::mat3 before(camera_.eye_from_scene), now(camera.eye_from_scene);
  float turn = 0.0F;
  for (int i = 0; i < 3; ++i) turn = std::max(turn, glm::length(now[i] - before[i]));
  return turn < kNearlySame && glm::length(camera.eye - camera_.eye) < kNearlySame * nearest_;
}

bool LinesOfSight::isSeenFrom(const glm::vec3& eye, std::size_t place) {
  if (last_eye_ >= eyes_.size() || eyes_[last_eye_].place != eye) {
    auto known = std::find_if(eyes_.begin(), eyes_.end(), [&](const Eye& other) { return other.place == eye; });
    if (known == eyes_.end()) known = eyes_.insert(known, {eye, std::vector<std::uint8_t>(met_.size(), 0)});
    last_eye_ = static_cast<std::size_t>(known - eyes_.begin());
  }
  std::uint8_t& verdict = eyes_[last_eye_].verdicts[place];
  if (verdict == 0) verdict = findOut(eye, place) ? 1 : 2;
  return verdict == 1;
}

/// Whether the same side of the place is seen from an eye as in the view.
bool LinesOfSight::findOut(const glm::vec3& eye, std::size_t place) const {
  const plan::SurfaceSample& met = met_[place];
  const bool is_front = glm::dot(met.normal, camera_.towardsViewer(met.position)) > 0.0F;
  if (is_front != (glm::dot(met.normal, eye - met.position) > 0.0F)) return false;
  return !sight_->isBlocked(met.position, eye, plan::sightClearance(*sight_));
}

}  // namespace

std::unique_ptr<SurfaceSight> makeSurfaceSight() {
  return std::make_unique<LinesOfSight>();
}

}  // namespace client
