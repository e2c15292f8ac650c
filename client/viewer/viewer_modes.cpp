#include <algorithm>

#include "client/viewer/viewer_impl.h"

namespace client {

// ---- pins ----

base::Result<void> Viewer::Impl::startPins() {
  probe.reset();
  drawn_signature = 0;
  if (pins.empty() || session.welcome() == nullptr || context_lost) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto made, PinProbe::create());
  probe = std::move(made);
  std::vector<glm::vec3> local;
  for (std::size_t i = 0; i < std::min(pins.size(), kMaxPins); ++i)
    local.emplace_back(pins[i] - session.welcome()->origin);
  probe->setPoints(std::move(local));
  return {};
}

/// Hashes everything that decides what hides what; pins are tested again only when the hash changes (FNV-1a, Fowler,
/// Noll and Vo 1991).
std::uint64_t Viewer::Impl::pictureSignature() const {
  std::uint64_t sum = 0xcbf29ce484222325U;
  const auto mix = [&sum](const void* data, std::size_t bytes) {
    const auto* byte = static_cast<const std::uint8_t*>(data);
    for (std::size_t i = 0; i < bytes; ++i) sum = (sum ^ byte[i]) * 0x100000001b3U;
  };
  const glm::mat4 clip = camera.clipFromScene();
  const glm::vec4 cut_plane = sectionHere();
  const std::vector<std::uint32_t>& drawn = patches.drawn().patches;
  mix(&clip, sizeof(clip));
  mix(&cut_plane, sizeof(cut_plane));
  mix(drawn.data(), drawn.size() * sizeof(std::uint32_t));
  if (hasSplats()) {
    const SplatStats stats = splats->stats();
    mix(&stats.nodes, sizeof(stats.nodes));
    mix(&stats.cutoff_px, sizeof(stats.cutoff_px));
  }
  return sum;
}

void Viewer::Impl::probePins() {
  if (!probe) return;
  probe->poll();
  const std::uint64_t signature = pictureSignature();
  if (signature != drawn_signature) probe->invalidate();
  drawn_signature = signature;
  probe->draw(camera, sectionHere(), showsSplats() ? splats->stats().cutoff_px : patches.drawn().error_px);
}

// ---- splats ----

void Viewer::Impl::addSplats(ViewerStats& stats) const {
  const bool pins_pending = probe && probe->pending();
  stats.splats = splats->stats();
  stats.error_px = stats.splats.cutoff_px;
  stats.tolerance_px = stats.splats.finest_px;
  stats.busy = hasSplats() && (splats->busy() || pins_pending);
  stats.complete = hasSplats() && splats->complete();
  stats.session.bytes_received = stats.splats.stream.bytes_received;
  stats.broken += static_cast<std::uint32_t>(stats.splats.stream.given_up);
  if (!stats.splats.warning.empty()) stats.last_fault = stats.splats.warning;
}

SplatLook Viewer::Impl::splatLook() const {
  SplatLook look;
  look.shading = shading;
  look.section = sectionHere();
  look.resolution_colors = options.lumigraph.modes.resolution_colors;
  look.lens = lens;
  std::copy_n(options.lumigraph.background, look.background.size(), look.background.begin());
  return look;
}

/// Takes over the view of a frame of splats; returns false while there are none. The server is told of no view, since
/// splats come by ranges of the file.
base::Result<bool> Viewer::Impl::setSplatView(const base::ViewCamera& wanted) {
  LUMIGRID_TRY(takeEvents());
  view = wanted;
  if (!hasSplats()) return false;
  scene = *splats->bounds();
  camera = cameraAt(wanted);
  return true;
}

base::Result<void> Viewer::Impl::updateSplats(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_splats, setSplatView(wanted));
  if (has_splats) splats->update(camera, splatLook());
  return {};
}

base::Result<void> Viewer::Impl::drawSplats(const base::ViewCamera& wanted) {
  LUMIGRID_ASSIGN_OR_RETURN(const bool has_splats, setSplatView(wanted));
  if (!has_splats) return {};
  LUMIGRID_TRY(splats->draw(camera, splatLook()));
  probePins();
  return {};
}

}  // namespace client
