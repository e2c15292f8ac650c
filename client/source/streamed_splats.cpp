#include "client/source/streamed_splats.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace client {
namespace {

// A splat is held as it was found, as the renderer sorts it, and on the GPU; the fourth part is the buffers' reserve.
constexpr std::uint64_t kBytesPerSplat = 4 * sizeof(lod::qsplat::Splat);
// Traversals of one frame at most, until it has no more splats than fit the time and the memory. A choice: the last one
// is drawn as it is.
constexpr int kMaxTries = 4;
// While blocks arrive and the view rests, choosing and drawing splats take one part of the time and decoding three: a
// page has one thread for both, and a frame of a million splats takes a second on some machines.
constexpr double kRestPerChoice = 3.0;

lod::qsplat::StreamOptions streamOptions(const SplatOptions& options) {
  lod::qsplat::StreamOptions stream;
  stream.memory_bytes = options.memory_bytes / 4;
  stream.order = options.order;
  stream.idle_bytes = options.idle_bytes;
  return stream;
}

lod::qsplat::RateGoal goalOf(const SplatOptions& options) {
  lod::qsplat::RateGoal goal;
  if (options.frame_seconds > 0.0) goal.frame_seconds = options.frame_seconds;
  goal.finest_px = std::max(options.cutoff_px, 0.1F);
  goal.coarsest_px = std::max(goal.coarsest_px, goal.finest_px);
  return goal;
}

/// Waits until the GPU is done with the framebuffer bound now. Reading a pixel waits on every platform; glFinish does
/// not in browsers.
void waitForGpu() {
  std::array<std::uint8_t, 4> pixel{};
  glReadPixels(0, 0, 1, 1, GL_RGBA, GL_UNSIGNED_BYTE, pixel.data());
}

}  // namespace

StreamedSplats::StreamedSplats(SplatFilePlace file, protocol::Welcome welcome, std::unique_ptr<RangeFetcher> fetcher,
                               const SplatOptions& options)
    : file_(std::move(file)),
      welcome_(protocol::encode(welcome)),
      fetcher_(std::move(fetcher)),
      options_(options),
      stream_(file_.bytes, streamOptions(options)),
      rate_(goalOf(options)) {}

StreamedSplats::StreamedSplats(SplatFilePlace file, protocol::Welcome welcome,
                               std::shared_ptr<lod::qsplat::FileBlocks> blocks, const SplatOptions& options)
    : file_(std::move(file)),
      welcome_(protocol::encode(welcome)),
      options_(options),
      stream_(std::move(blocks), streamOptions(options)),
      rate_(goalOf(options)) {}

// ---- the link ----

bool StreamedSplats::pump(Session& session, double now) {
  std::vector<FetchAnswer> answers;
  if (fetcher_) answers = fetcher_->takeAnswers();
  for (FetchAnswer& answer : answers) acceptAnswer(session, answer, now);
  if (refusal_.empty() && !stream_.problem().empty())
    refusal_ = file_.place + "/" + file_.name + ": " + stream_.problem();
  if (!refusal_.empty()) {
    if (session.phase() != SessionPhase::kRefused) session.refuse(refusal_);
    return !answers.empty();
  }
  for (const lod::qsplat::ByteRange& range : stream_.nextRequests(now))
    fetcher_->submit(range.id, file_.name, range.offset, range.length);
  if (stream_.complete()) host_away_ = false;  // no more requests are sent, so nothing could show that the host is back
  if (session.phase() == SessionPhase::kDisconnected && stream_.header() != nullptr && !host_away_)
    sendWelcome(session);
  return !answers.empty();
}

void StreamedSplats::acceptAnswer(Session& session, FetchAnswer& answer, double now) {
  if (answer.outcome == FetchOutcome::kBytes) {
    host_away_ = false;
    stream_.acceptAnswer(answer.id, answer.bytes, now);
    return;
  }
  const std::string why = describeFailure(answer, file_.place + "/" + file_.name);
  if (isTransient(answer)) {
    host_away_ = true;
    stream_.acceptFailure(answer.id, now);
    session.disconnected(why);
  } else {
    if (refusal_.empty()) refusal_ = why;
    stream_.giveUp(why);
  }
}

/// Greets the session as a server would. Its answers are dropped, since views are not sent to anybody.
void StreamedSplats::sendWelcome(Session& session) {
  session.connected();
  if (auto taken = session.receive(welcome_); !taken) refusal_ = file_.place + ": " + taken.error().message;
  while (session.nextToSend()) {
  }
}

// ---- which splats ----

const base::Sphere* StreamedSplats::bounds() const {
  return stream_.header() != nullptr ? &stream_.header()->root : nullptr;
}

float StreamedSplats::finestCutoff() const {
  return cutoff_factor_ > 1.0F ? cutoff_factor_ * std::max(options_.cutoff_px, 0.1F) : options_.cutoff_px;
}

float StreamedSplats::wantedCutoff() const {
  if (options_.frame_seconds <= 0.0) return finestCutoff();
  // At its finest the control may differ from the option by rounding, and it does not know the option's 0.
  const float wanted = rate_.cutoffPx() <= rate_.goal().finest_px ? options_.cutoff_px : rate_.cutoffPx();
  return std::max(wanted, finestCutoff());
}

/// Whether requests of the last traversal are still under way. Until they are answered another traversal would find
/// little else, and would cost more time than the answers take.
bool StreamedSplats::moreIsComing() const {
  const lod::qsplat::StreamStats stats = stream_.stats();
  return stats.wanted > 0 && stats.requested > 0;
}

void StreamedSplats::update(const base::Camera& camera, const SplatLook& look) {
  const bool same_view = chosen_ && base::sameCamera(camera, camera_) && look.section == section_ && look.lens == lens_;
  if (same_view && moreIsComing() && (!options_.clock || !hasRested())) return;
  const double begin = now();
  chooseSplats(camera, look);
  choice_end_ = now();
  choice_seconds_ = choice_end_ - begin;
}

/// Whether the last choice of splats was so long ago that the next one may come before all requests are answered. It
/// orders the requests anew, so that the largest splats found meanwhile come before the finest of those known before.
bool StreamedSplats::hasRested() const {
  return now() - choice_end_ >= kRestPerChoice * choice_seconds_;
}

void StreamedSplats::chooseSplats(const base::Camera& camera, const SplatLook& look) {
  if (stream_.header() == nullptr) return;
  const bool same_view = chosen_ && base::sameCamera(camera, camera_) && look.section == section_;
  if (!same_view) cutoff_factor_ = 1.0F;
  if (same_view && look.lens == lens_ && wantedCutoff() == cutoff_px_ && stream_.generation() == found_generation_)
    return;
  camera_ = camera;
  section_ = look.section;
  lens_ = look.lens;
  chosen_ = true;

  lod::qsplat::TraverseRequest request;
  request.camera = camera;
  request.cull_back_faces = !options_.back_faces;
  request.section = look.section;
  request.for_each = options_.for_each;
  const std::uint64_t most = std::max<std::uint64_t>(options_.memory_bytes / 2 / kBytesPerSplat, 1);
  for (int attempt = 0; attempt < kMaxTries; ++attempt) {
    found_generation_ = stream_.generation();
    cutoff_px_ = request.cutoff_px = wantedCutoff();
    stream_.traverse(request, look.lens, found_);
    const bool last = attempt + 1 == kMaxTries;
    const bool in_time = last || options_.frame_seconds <= 0.0 || !rate_.coarsenIfLate(found_.splats.size());
    if (found_.splats.size() <= most) {
      if (in_time) return;
      continue;
    }
    // The number of splats is proportional to 1 / cut-off².
    const float factor = std::sqrt(static_cast<float>(found_.splats.size()) / static_cast<float>(most));
    cutoff_factor_ = 1.05F * factor * std::max(cutoff_px_, 0.1F) / std::max(options_.cutoff_px, 0.1F);
  }
}

/// Makes a frame of the same view finer than the one before.
void StreamedSplats::setPace(const base::Camera& camera) {
  if (options_.frame_seconds <= 0.0) return;
  if (drawn_from_ && base::sameCamera(*drawn_from_, camera))
    rate_.refineAtRest();
  else
    rate_.beginMotion();
}

// ---- drawing ----

base::Result<void> StreamedSplats::draw(const base::Camera& camera, const SplatLook& look) {
  const bool moved = !drawn_from_ || !base::sameCamera(*drawn_from_, camera);
  const double begin = now();
  setPace(camera);
  chooseSplats(camera, look);
  drawn_from_ = camera;
  LUMIGRID_TRY(drawFound(camera, look));
  if (moved && stream_.header() != nullptr && options_.clock && options_.frame_seconds > 0.0) {
    waitForGpu();
    rate_.recordFrame(now() - begin, found_.splats.size());
  }
  choice_end_ = now();
  choice_seconds_ = choice_end_ - begin;
  return {};
}

base::Result<void> StreamedSplats::drawFound(const base::Camera& camera, const SplatLook& look) {
  GLint framebuffer = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &framebuffer);
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glClearColor(look.background[0], look.background[1], look.background[2], look.background[3]);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
  if (stream_.header() == nullptr) return {};

  if (!renderer_) {
    LUMIGRID_ASSIGN_OR_RETURN(auto made, lod::draw::SplatRenderer::create());
    renderer_ = std::move(made);
  }
  lod::draw::SplatView view;
  view.camera = camera;
  view.shading = look.shading;
  view.section = look.section;
  view.two_sided = options_.back_faces || look.section != base::kNoSection;
  view.colors = look.resolution_colors ? lod::draw::SplatColors::kResolution : lod::draw::SplatColors::kSurface;
  reduction_ = options_.frame_seconds > 0.0 ? rate_.reduction() : 1.0F;
  return renderer_->draw(
      found_.splats, options_.kernel, view,
      {static_cast<GLuint>(framebuffer), camera.width, camera.height, look.background[3] > 0.0F, reduction_});
}

std::optional<glm::vec3> StreamedSplats::surfaceAt(const base::Camera& camera, const SplatLook& look, double x,
                                                   double y) const {
  const glm::dmat4 scene_from_clip = glm::inverse(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene));
  const double u = 2.0 * (x / camera.width) - 1.0;
  const double v = 1.0 - 2.0 * (y / camera.height);
  const glm::dvec4 near_point = scene_from_clip * glm::dvec4(u, v, -1.0, 1.0);
  const glm::dvec4 far_point = scene_from_clip * glm::dvec4(u, v, 1.0, 1.0);
  const glm::dvec3 origin = glm::dvec3(near_point) / near_point.w;
  const glm::dvec3 direction = glm::normalize(glm::dvec3(far_point) / far_point.w - origin);

  // Intersect the ray with the disc of each splat that faces it, as a circle is drawn.
  double nearest = std::numeric_limits<double>::infinity();
  for (const lod::qsplat::Splat& splat : found_.splats) {
    const glm::dvec3 to_center = glm::dvec3(splat.center) - origin;
    const double along = glm::dot(to_center, direction);
    const double radius = static_cast<double>(splat.radius);
    if (along < 0.0 || along >= nearest || glm::dot(to_center, to_center) - along * along > radius * radius) continue;
    const glm::vec3 point(origin + along * direction);
    if (glm::dot(glm::vec3(look.section), point) - look.section.w <= 0.0F) nearest = along;
  }
  if (!std::isfinite(nearest)) return std::nullopt;
  return glm::vec3(origin + nearest * direction);
}

void StreamedSplats::setQuality(const SplatQuality& quality) {
  static_cast<SplatQuality&>(options_) = quality;
  cutoff_factor_ = 1.0F;  // relative to the previous cut-off, hence void
  rate_.setGoal(goalOf(options_));
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

SplatStats StreamedSplats::stats() const {
  SplatStats stats;
  stats.splats = found_.splats.size();
  stats.nodes = found_.nodes;
  stats.cutoff_px = cutoff_px_;
  stats.finest_px = finestCutoff();
  stats.reduction = reduction_;
  stats.lens_px = lens_ ? lod::qsplat::cutoffThroughLens(cutoff_px_) : 0.0F;
  stats.limited = cutoff_factor_ > 1.0F || stream_.limitedByMemory();
  stats.buffer_bytes = found_.splats.size() * kBytesPerSplat;
  stats.stream = stream_.stats();
  stats.warning = stream_.warning();
  return stats;
}

}  // namespace client
