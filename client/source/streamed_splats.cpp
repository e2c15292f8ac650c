#include "client/source/streamed_splats.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/format_text.h"
#include "base/text.h"
#include "client/source/scene_ray.h"
#include "client/source/streamed_draw.h"

namespace client {
namespace {

// A splat is held as it was found, as the renderer sorts it, and on the GPU; the fourth part is the buffers' reserve.
constexpr std::uint64_t kBytesPerSplat = 4 * sizeof(lod::qsplat::Splat);
// Traversals of one frame at most, until it has no more splats than fit the time and the memory. A choice: the last one
// is drawn as it is.
constexpr int kMaxTries = 4;

lod::qsplat::StreamOptions streamOptions(const StreamedOptions& options) {
  lod::qsplat::StreamOptions stream;
  stream.memory_bytes = options.memory_bytes / 4;
  stream.order = options.order;
  stream.idle_bytes = options.idle_bytes;
  return stream;
}

}  // namespace

StreamedSplats::StreamedSplats(FilePlace file, const protocol::Welcome& welcome, std::unique_ptr<RangeFetcher> fetcher,
                               const StreamedOptions& options)
    : file_(std::move(file), welcome, std::move(fetcher)),
      options_(options),
      stream_(file_.place().bytes, streamOptions(options)),
      pace_(options.frame_seconds, options.cutoff_px) {}

StreamedSplats::StreamedSplats(FilePlace file, const protocol::Welcome& welcome,
                               std::shared_ptr<lod::qsplat::FileBlocks> blocks, const StreamedOptions& options)
    : file_(std::move(file), welcome, nullptr),
      options_(options),
      stream_(std::move(blocks), streamOptions(options)),
      pace_(options.frame_seconds, options.cutoff_px) {}

// ---- which splats ----

const base::Sphere* StreamedSplats::bounds() const {
  return stream_.header() != nullptr ? &stream_.header()->root : nullptr;
}

float StreamedSplats::finestCutoff() const {
  return cutoff_factor_ > 1.0F ? cutoff_factor_ * std::max(options_.cutoff_px, 0.1F) : options_.cutoff_px;
}

/// Whether requests of the last traversal are still under way. Until they are answered another traversal would find
/// little else, and would cost more time than the answers take.
bool StreamedSplats::moreIsComing() const {
  const lod::qsplat::StreamStats stats = stream_.stats();
  return stats.wanted > 0 && stats.requested > 0;
}

void StreamedSplats::update(const base::Camera& camera, const StreamedLook& look) {
  const bool same_view = chosen_ && base::sameCamera(camera, camera_) && look.lens == lens_;
  if (same_view && moreIsComing() && (!options_.clock || !hasRested())) return;
  const double begin = now();
  chooseSplats(camera, look);
  choices_.record(begin, now());
}

/// Whether the last choice of splats was so long ago that the next one may come before all requests are answered. It
/// orders the requests anew, so that the largest splats found meanwhile come before the finest of those known before.
bool StreamedSplats::hasRested() const {
  return choices_.hasRested(now());
}

void StreamedSplats::chooseSplats(const base::Camera& camera, const StreamedLook& look) {
  if (stream_.header() == nullptr) return;
  const bool same_view = chosen_ && base::sameCamera(camera, camera_);
  if (!same_view) cutoff_factor_ = 1.0F;
  if (same_view && look.lens == lens_ && pace_.wantedPx(finestCutoff()) == cutoff_px_ &&
      stream_.generation() == found_generation_)
    return;
  camera_ = camera;
  lens_ = look.lens;
  chosen_ = true;

  lod::qsplat::TraverseRequest request;
  request.camera = camera;
  request.cull_back_faces = !options_.back_faces;
  request.for_each = options_.for_each;
  const std::uint64_t most = std::max<std::uint64_t>(options_.memory_bytes / 2 / kBytesPerSplat, 1);
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    found_generation_ = stream_.generation();
    cutoff_px_ = request.cutoff_px = pace_.wantedPx(finestCutoff());
    stream_.traverse(request, look.lens, found_);
    const bool last = attempt + 1 == kMaxTries;
    const bool in_time = last || !pace_.coarsenIfLate(found_.splats.size());
    if (found_.splats.size() <= most) {
      if (in_time) return;
      continue;
    }
    // The number of splats is proportional to 1 / cut-off².
    const float factor = std::sqrt(static_cast<float>(found_.splats.size()) / static_cast<float>(most));
    cutoff_factor_ = 1.05F * factor * std::max(cutoff_px_, 0.1F) / std::max(options_.cutoff_px, 0.1F);
  }
}

// ---- drawing ----

base::Result<void> StreamedSplats::draw(const base::Camera& camera, const StreamedLook& look) {
  const double begin = now();
  const bool moved = pace_.beginFrame(camera);
  chooseSplats(camera, look);
  LUMIGRID_TRY(drawFound(camera, look));
  if (moved && stream_.header() != nullptr && options_.clock && pace_.isOn()) {
    waitForGpu();
    pace_.recordFrame(now() - begin, found_.splats.size());
  }
  choices_.record(begin, now());
  return {};
}

base::Result<void> StreamedSplats::drawFound(const base::Camera& camera, const StreamedLook& look) {
  GLint framebuffer = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &framebuffer);
  clearPicture(look.background);
  if (stream_.header() == nullptr) return {};

  if (!renderer_) {
    LUMIGRID_ASSIGN_OR_RETURN(auto made, lod::draw::SplatRenderer::create());
    renderer_ = std::move(made);
  }
  lod::draw::SplatView view;
  view.camera = camera;
  view.shading = look.shading;
  view.two_sided = options_.back_faces || camera.hasSection();
  view.colors = look.resolution_colors ? lod::draw::SplatColors::kResolution : lod::draw::SplatColors::kSurface;
  reduction_ = pace_.reduction();
  return renderer_->draw(
      found_.splats, options_.kernel, view,
      {static_cast<GLuint>(framebuffer), camera.width, camera.height, look.background[3] > 0.0F, reduction_});
}

std::optional<glm::vec3> StreamedSplats::surfaceAt(const base::Camera& camera, double x, double y) const {
  RayHit hit{rayThrough(camera, x, y), camera.section};
  // Each splat that faces the ray counts as the disc that a circle is drawn as.
  for (const lod::qsplat::Splat& splat : found_.splats)
    hit.keep(distanceToPoint(hit.ray, glm::dvec3(splat.center), static_cast<double>(splat.radius)));
  return hit.place();
}

void StreamedSplats::setQuality(const StreamedQuality& quality) {
  static_cast<StreamedQuality&>(options_) = quality;
  cutoff_factor_ = 1.0F;  // relative to the previous cut-off, hence void
  pace_.setGoal(options_.frame_seconds, options_.cutoff_px);
}

// ---- figures ----

bool StreamedSplats::complete() const {
  return chosen_ && stream_.complete() && found_generation_ == stream_.generation() && cutoff_px_ <= finestCutoff();
}

bool StreamedSplats::busy() const {
  if (!chosen_ || cutoff_px_ > finestCutoff()) return chosen_;
  if (found_generation_ == stream_.generation()) return false;
  return !moreIsComing() || !options_.clock || hasRested();
}

std::vector<StatisticsLine> describeSplats(const StreamedStats& s) {
  const SplatStats& splats = s.splats;
  const auto count = [](std::uint64_t value) { return base::formatCount(value, ' '); };
  const auto px = [](const char* pattern, float value) {
    return base::formatText(pattern, static_cast<double>(value));
  };
  return {{"splats", count(s.drawn) + px(", down to %.1f px", s.error_px) +
                         (splats.reduction > 1.0F ? px(", one sample for %.1f px", splats.reduction) : std::string()) +
                         (splats.lens_px > 0.0F ? px(", %.1f in the glass", splats.lens_px) : std::string())},
          {"blocks", count(splats.stream.present) + " of " + count(splats.stream.blocks) + " here, " +
                         count(splats.stream.requested) + " requested, " + count(splats.stream.wanted) + " wanted"}};
}

StreamedStats StreamedSplats::stats() const {
  StreamedStats stats;
  stats.drawn = found_.splats.size();
  stats.error_px = cutoff_px_;
  stats.finest_px = finestCutoff();
  stats.limited = cutoff_factor_ > 1.0F || stream_.limitedByMemory();
  stats.buffer_bytes = found_.splats.size() * kBytesPerSplat;
  const lod::qsplat::StreamStats stream = stream_.stats();
  stats.file_bytes = stream.memory_bytes;
  stats.bytes_received = stream.bytes_received;
  stats.requests = stream.requests;
  stats.present = stream.present;
  stats.lacking = stream.wanted + stream.requested;
  stats.broken = static_cast<std::uint32_t>(stream.given_up);
  stats.warning = stream_.warning();
  stats.describe = describeSplats;
  stats.splats = {found_.nodes, reduction_, lens_ ? lod::qsplat::cutoffThroughLens(cutoff_px_) : 0.0F, stream};
  return stats;
}

}  // namespace client
