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
  const glm::vec4 cut_plane = sectionHere();
  const std::vector<std::uint32_t>& drawn = patches_.drawn().patches;
  mix(&clip, sizeof(clip));
  mix(&cut_plane, sizeof(cut_plane));
  mix(drawn.data(), drawn.size() * sizeof(std::uint32_t));
  if (hasSplats()) {
    const SplatStats stats = splats_->stats();
    mix(&stats.nodes, sizeof(stats.nodes));
    mix(&stats.cutoff_px, sizeof(stats.cutoff_px));
  }
  return sum;
}

void Viewer::probePins() {
  if (!probe_) return;
  probe_->poll();
  const std::uint64_t signature = pictureSignature();
  if (signature != drawn_signature_) probe_->invalidate();
  drawn_signature_ = signature;
  probe_->draw(camera_, sectionHere(), showsSplats() ? splats_->stats().cutoff_px : errorOf(patches_.drawn()));
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

// ---- splats ----

void Viewer::addSplats(ViewerStats& stats) const {
  const bool pins_pending = probe_ && probe_->pending();
  stats.splats = splats_->stats();
  stats.error_px = stats.splats.cutoff_px;
  stats.tolerance_px = stats.splats.finest_px;
  stats.busy = hasSplats() && (splats_->busy() || pins_pending);
  stats.complete = hasSplats() && splats_->complete();
  stats.session.bytes_received = stats.splats.stream.bytes_received;
  stats.broken += static_cast<std::uint32_t>(stats.splats.stream.given_up);
  if (!stats.splats.warning.empty()) stats.last_fault = stats.splats.warning;
}

SplatLook Viewer::splatLook() const {
  SplatLook look;
  look.shading = shading_;
  if (options_.lumigraph.modes.hasLight()) look.shading = {false, options_.lumigraph.modes.light};
  look.section = sectionHere();
  look.resolution_colors = options_.lumigraph.modes.resolution_colors;
  look.lens = lens_;
  std::copy_n(options_.lumigraph.background, look.background.size(), look.background.begin());
  return look;
}

/// Takes over the view of a frame of splats; returns false while there are none. The server is told of no view, since
/// splats come by ranges of the file.
base::Result<bool> Viewer::setSplatView(const base::ViewCamera& wanted) {
  LUMIGRID_TRY(takeEvents());
  view_ = wanted;
  if (!hasSplats()) return false;
  scene_ = *splats_->bounds();
  camera_ = cameraAt(wanted);
  return true;
}

base::Result<void> Viewer::updateSplats(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_splats, setSplatView(wanted));
  if (has_splats) splats_->update(camera_, splatLook());
  return {};
}

base::Result<void> Viewer::drawSplats(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_splats, setSplatView(wanted));
  if (!has_splats) return {};
  LUMIGRID_TRY(splats_->draw(camera_, splatLook()));
  probePins();
  return {};
}

}  // namespace client
