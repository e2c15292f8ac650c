#include "client/viewer/viewer.h"

#include <algorithm>
#include <cmath>

namespace client {

// ---- pins ----

base::Result<void> Viewer::startPins() {
  probe_.reset();
  drawn_signature_ = 0;
  if (pins_.empty() || session_.welcome() == nullptr || context_lost_) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto made, PinProbe::create());
  probe_ = std::move(made);
  std::vector<glm::vec3> local;
  for (std::size_t i = 0; i < std::min(pins_.size(), kMaxPins); ++i)
    local.emplace_back(pins_[i] - session_.welcome()->origin);
  probe_->setPoints(std::move(local));
  return {};
}

/// Hashes everything that decides what hides what; pins are tested again only when the hash changes (FNV-1a, Fowler,
/// Noll and Vo 1991).
std::uint64_t Viewer::pictureSignature() const {
  std::uint64_t sum = 0xcbf29ce484222325U;
  const auto mix = [&sum](const void* data, std::size_t bytes) {
    const auto* byte = static_cast<const std::uint8_t*>(data);
    for (std::size_t i = 0; i < bytes; ++i) sum = (sum ^ byte[i]) * 0x100000001b3U;
  };
  const glm::mat4 clip = camera_.clipFromScene();
  const std::vector<std::uint32_t>& drawn = patches_.drawn().patches;
  mix(&clip, sizeof(clip));
  mix(&camera_.section, sizeof(camera_.section));
  mix(drawn.data(), drawn.size() * sizeof(std::uint32_t));
  if (hasStreamed()) {
    const StreamedStats stats = streamed_->stats();
    mix(&stats.drawn, sizeof(stats.drawn));
    mix(&stats.error_px, sizeof(stats.error_px));
  }
  return sum;
}

void Viewer::probePins() {
  if (!probe_) return;
  probe_->poll();
  const std::uint64_t signature = pictureSignature();
  if (signature != drawn_signature_) probe_->invalidate();
  drawn_signature_ = signature;
  if (showsStreamed())
    probe_->draw(streamed_->drawnCamera(), streamed_->stats().error_px);
  else
    probe_->draw(renderer_->drawnCamera(), errorOf(patches_.drawn()));
}

// ---- light ----

void Viewer::setLight(const std::optional<glm::dvec3>& direction) {
  const double length = direction ? glm::length(*direction) : 0.0;
  glm::vec3& light = options_.lumigraph.modes.light;
  light = length > 0.0 && std::isfinite(length) ? glm::vec3(*direction / length) : glm::vec3(0.0F);
}

/// How colours come before the viewer's own light shades them.
lod::draw::Shading Viewer::shadingHere() const {
  lod::draw::Shading shading = shading_;
  shading.unlit = shading.unlit || options_.lumigraph.modes.hasLight();
  return shading;
}

// ---- streamed methods ----

void Viewer::addStreamed(ViewerStats& stats) const {
  const bool pins_pending = probe_ && probe_->pending();
  stats.streamed = streamed_->stats();
  stats.error_px = stats.streamed.error_px;
  stats.tolerance_px = stats.streamed.finest_px;
  stats.busy = hasStreamed() && (streamed_->busy() || pins_pending);
  stats.complete = hasStreamed() && streamed_->complete();
  stats.session.bytes_received = stats.streamed.bytes_received;
  stats.broken += stats.streamed.broken;
  if (!stats.streamed.warning.empty()) stats.last_fault = stats.streamed.warning;
}

StreamedLook Viewer::streamedLook() const {
  StreamedLook look;
  look.shading = shading_;
  look.own_light = options_.lumigraph.modes.hasLight();
  if (look.own_light) look.shading = {false, options_.lumigraph.modes.light};
  look.resolution_colors = options_.lumigraph.modes.resolution_colors;
  look.lens = lens_;
  std::copy_n(options_.lumigraph.background, look.background.size(), look.background.begin());
  return look;
}

/// Takes over the view of a frame of a streamed method; returns false while it has nothing. The server is told of no
/// view, since the data come by ranges of a file.
base::Result<bool> Viewer::setStreamedView(const base::ViewCamera& wanted) {
  LUMIGRID_TRY(takeEvents());
  view_ = wanted;
  if (!hasStreamed()) return false;
  scene_ = *streamed_->bounds();
  camera_ = cameraAt(wanted);
  return true;
}

base::Result<void> Viewer::updateStreamed(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_streamed, setStreamedView(wanted));
  if (has_streamed) streamed_->update(camera_, streamedLook());
  return {};
}

base::Result<void> Viewer::drawStreamed(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_streamed, setStreamedView(wanted));
  if (!has_streamed) return {};
  GLint target = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &target);
  effort_ = streamed_->isMultisampled() ? fittingEffort({.samples = options_.samples}) : DrawEffort{};
  const bool apart = bindTarget(camera_.width, camera_.height, effort_);
  if (!apart) {
    effort_.samples = 1;
    glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(target));
  }
  LUMIGRID_TRY(streamed_->draw(camera_, streamedLook()));
  probePins();
  if (apart) picture_.resolveTo(static_cast<GLuint>(target), camera_.width, camera_.height);
  return {};
}

}  // namespace client
