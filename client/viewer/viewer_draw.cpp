#include <algorithm>

#include "client/viewer/viewer.h"

namespace client {
namespace {

/// Compares with a tolerance where rounding is possible: directions are normalized again where they arrive.
bool showsSameView(const base::ViewCamera& a, const base::ViewCamera& b) {
  const auto near = [](const glm::dvec3& u, const glm::dvec3& v) { return glm::length(u - v) <= 1e-9; };
  return a.position == b.position && near(a.direction, b.direction) &&
         near(glm::normalize(a.up), glm::normalize(b.up)) && a.fov_y == b.fov_y && a.width == b.width &&
         a.height == b.height && a.ortho_height == b.ortho_height;
}

}  // namespace

base::Result<void> Viewer::draw(const base::ViewCamera& camera, double now) {
  if (showsSplats()) {
    if (context_lost_) return {};
    if (hasSplats()) return drawSplats(camera);
    drawBackground();
    return takeEvents();
  }
  if (const auto more = update(camera, now); !more) return more.error();
  const bool moved = !showsSameView(drawn_view_, view_);
  drawn_view_ = view_;
  if (context_lost_) return {};
  if (!renderer_) {
    drawBackground();
    return {};
  }
  frame_.update(framesOfThisView(), moved, blendIsFine(), options_.lumigraph.fade_seconds > 0.0F, now);
  drawBlended(moved, now);
  if (!options_.lumigraph.unseen) drawFrames();
  return {};
}

base::Result<void> Viewer::drawUnseen(const base::ViewCamera& camera, double now) {
  options_.lumigraph.unseen = true;
  auto drawn = draw(camera, now);
  options_.lumigraph.unseen = false;
  return drawn;
}

// ---- the blended picture ----

/// Draws the proxy with its images. Under a frame that hides it, only depth maps and fades go on, so that the picture
/// is ready when the view moves; pins are tested against its depth.
void Viewer::drawBlended(bool moved, double now) {
  candidates_.clear();
  for (SampleId id : ranked_)
    if (images_[id].state == ImageState::kResident) candidates_.push_back(id);
  LumigraphOptions options = options_.lumigraph;
  options.max_samples = imagesBlended();
  options.modes.section = sectionHere();
  const bool hidden = frame_.whole() || frame_.under();
  options.unseen = options.unseen || (hidden && !probe_);
  GLint target = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &target);
  const int samples = hidden ? 1 : fittingSamples(samplesWanted(moved));
  const bool has_samples = !options.unseen && bindSamples(samples);
  options.multisampled = has_samples;
  const lod::patch::Cut& cut = patches_.drawn();
  renderer_->draw(camera_, cut.patches, candidates_, cut.bound_px, shading_, options, now, patches_.occluders(),
                  cut.patch_bound_px, proxyErrors());
  if (options.unseen) return;
  probePins();
  if (has_samples) samples_.resolveTo(static_cast<GLuint>(target));
  samples_per_pixel_ = has_samples ? samples : 1;
}

std::vector<ProxyError> Viewer::proxyErrors() const {
  const lod::patch::Hierarchy& hierarchy = session_.hierarchy();
  std::vector<ProxyError> errors;
  for (const std::uint32_t number : patches_.drawn().patches) {
    const lod::patch::Patch& patch = hierarchy.patches[number];
    errors.push_back(
        {patch.own_typical_error, lod::patch::typicalColorErrorOf(patch, renderer_->patches().meanEdge(number))});
  }
  return errors;
}

// ---- samples ----

/// Returns the samples a pixel of the next picture. The last picture of a view at rest gets all; those that another
/// soon follows get what frame times allow.
int Viewer::samplesWanted(bool moved) const {
  if (!options_.adapt_samples) return options_.samples;
  const bool fades = options_.lumigraph.fade_seconds > 0.0F;
  const bool passing = more_to_do_ || !session_.complete() || (fades && (moved || settling()));
  return passing ? governor_.whileMoving() : samplesAtRest();
}

int Viewer::samplesAtRest() const {
  return governor_.most() > 1 ? 2 * governor_.most() : 1;
}

int Viewer::fittingSamples(int wanted) const {
  int samples = samples_refused_ ? 1 : wanted;
  if (samples <= 1) return 1;
  using base::gl::MultisampledTarget;
  GLint most = 1;
  glGetIntegerv(GL_MAX_SAMPLES, &most);
  while (samples > 1 &&
         (samples > most || MultisampledTarget::bytesOf(camera_.width, camera_.height, samples) > plan_.samples))
    samples /= 2;
  return samples;
}

/// Makes the picture's samples the target. False where it has one a pixel.
bool Viewer::bindSamples(int samples) {
  if (samples <= 1) return false;
  if (!samples_.fits(camera_.width, camera_.height, samples)) {
    samples_ = {};
    auto made = base::gl::MultisampledTarget::create(camera_.width, camera_.height, samples);
    samples_refused_ = !made;
    if (!made) {
      fault(made.error().message);
      return false;
    }
    samples_ = std::move(*made);
  }
  samples_.bind();
  return true;
}

/// Whether the view rests with a picture that has fewer samples than it may have. A frame shown whole needs none.
bool Viewer::samplesPending() const {
  return renderer_ && options_.adapt_samples && !frame_.shown() && session_.complete() && !more_to_do_ && !settling() &&
         samples_per_pixel_ < fittingSamples(samplesAtRest());
}

bool Viewer::settling() const {
  return renderer_ && (renderer_->settling() || frame_.fading());
}

base::Image readPicture(const base::gl::RenderTarget& target, const Viewer& viewer) {
  base::Image picture = target.read();
  if (viewer.options().method == Method::kQsplat) return picture;
  for (std::size_t i = 0; i < picture.pixels.size(); i += 4) {
    const int alpha = picture.pixels[i + 3];
    for (std::size_t k = i; alpha > 0 && alpha < 255 && k < i + 3; ++k)
      picture.pixels[k] = static_cast<std::uint8_t>(std::min(255, (255 * picture.pixels[k] + alpha / 2) / alpha));
  }
  return picture;
}

// ---- the server's frame itself ----

/// A server's frame shows the model as it is, in perspective: whatever alters the picture here is missing in it.
bool Viewer::mayShowFrames() const {
  return !section_ && options_.lumigraph.use_images && !options_.lumigraph.modes.resolution_colors &&
         !view_.orthographic();
}

bool Viewer::showsThisView(SampleId id) const {
  if ((id & kFrameTag) == 0) return false;
  const protocol::Frame* frame = session_.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
  return frame != nullptr && showsSameView(frame->camera, view_);
}

/// Returns the frames of the present view that are on the GPU, oldest first.
std::vector<SampleId> Viewer::framesOfThisView() const {
  std::vector<SampleId> frames;
  if (!mayShowFrames()) return frames;
  for (const auto& [id, image] : images_)
    if (image.state == ImageState::kResident && showsThisView(id) && renderer_->canDrawWhole(id, camera_))
      frames.push_back(id);
  std::sort(frames.begin(), frames.end());
  return frames;
}

void Viewer::drawFrames() {
  const float* color = options_.lumigraph.background;
  const std::array<float, 4> background{color[0], color[1], color[2], color[3]};
  if (frame_.under()) renderer_->drawWhole(*frame_.under(), camera_, background, 1.0F);
  if (frame_.shown()) renderer_->drawWhole(*frame_.shown(), camera_, background, frame_.opacity());
}

}  // namespace client
