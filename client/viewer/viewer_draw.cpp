#include <algorithm>
#include <cmath>
#include <utility>

#include "client/viewer/viewer.h"

namespace client {
namespace {

int scaled(int pixels, float scale) {
  return std::max(1, static_cast<int>(std::lround(scale * static_cast<float>(pixels))));
}

/// By so many mip levels images are looked up finer where the mean of several pictures is shown. Measured:
/// docs/decisions/antialiasing.md.
constexpr float kSharperMeans = 0.45F;
/// BlendTuning::footprint of each of these pictures, which lie side by side in a pixel. Measured:
/// docs/decisions/image-footprints.md.
constexpr float kFootprintOfMeans = 0.2F;

constexpr int kEnoughSamples = 4;  ///< a pixel; more are only taken where there is room

/// The proxy's colours lack the shadows that images show, so they count where no image shows a place, and tell nothing
/// of an image.
void trustImages(BlendTuning& tuning) {
  tuning.shade_weight = 0.0F;
  tuning.lit_outlier = 1e6F;
}

/// So long after its last motion a view still counts as moving.
constexpr double kMotionSeconds = 0.25;

/// While finer patches come, the picture is renewed after so many seconds at the soonest. A choice.
constexpr double kRenewSeconds = 0.5;

}  // namespace

base::Result<void> Viewer::draw(const base::ViewCamera& camera, double now) {
  if (showsStreamed()) {
    if (context_lost_) return {};
    if (hasStreamed()) return drawStreamed(camera);
    drawBackground();
    return takeEvents();
  }
  if (const auto more = update(camera, now); !more) return more.error();
  const bool moved = !base::showsSameView(drawn_view_, view_);
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
  for (SampleId id : ranked_) {
    // Where a frame was drawn with a section, it shows what lies behind the part that was cut away.
    const base::Camera& camera = images_[id].camera;
    const bool serves = !camera.hasSection() || camera.section == camera_.section;
    if (images_[id].state == ImageState::kResident && serves) candidates_.push_back(id);
  }
  LumigraphOptions options = options_.lumigraph;
  options.use_images = options.use_images && (shading_.unlit || !options.modes.hasLight());
  if (session_.welcome()->shadows) trustImages(options.tuning);
  const bool hidden = frame_.whole() || frame_.under();
  options.unseen = options.unseen || (hidden && !probe_);
  GLint target = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &target);
  const bool looks = options.use_images && sight_ && sight_->lookFrom(camera_, looksRoughly(now));
  options.surface = looks ? &sight_->surface() : nullptr;
  const DrawEffort asked = hidden ? DrawEffort{} : effortWanted(moved, now);
  DrawEffort effort = fittingEffort(asked);
  if (!options.unseen && effort.pictures > 1 && !prepareMean()) effort = fittingEffort(asked);
  options.max_samples = imagesBlended();
  if (!moved && hasAll() && isAtRest(now)) options.more_samples = moreAtRest();
  options.max_points_a_patch = effort.points;
  shows_older_ = false;
  if (options.unseen) return drawProxy(camera_, options, now);
  if (effort.pictures > 1) {
    drawMean(optionsAtRest(options), effort, static_cast<GLuint>(target), now);
  } else if (hasMean(optionsAtRest(options))) {
    // A finished picture of this view stays until a better one is finished.
    options.unseen = true;
    drawProxy(camera_, options, now);
    showMean(static_cast<GLuint>(target));
    shows_older_ = true;
    return;
  } else {
    base::Camera camera = camera_;
    camera.width = scaled(camera_.width, effort.scale);
    camera.height = scaled(camera_.height, effort.scale);
    const bool apart = bindTarget(camera.width, camera.height, effort);
    if (!apart) effort.samples = 1, effort.scale = 1.0F, camera = camera_;
    options.multisampled = effort.samples > 1;
    options.blend_once = options.blend_once && blendsOnce(camera.width, camera.height, apart ? effort.samples : 0);
    drawProxy(camera, options, now);
    probePins();
    if (apart) picture_.resolveTo(static_cast<GLuint>(target), camera_.width, camera_.height);
  }
  effort_ = effort;
  asked_effort_ = asked;
}

void Viewer::drawProxy(const base::Camera& camera, const LumigraphOptions& options, double now) {
  const lod::patch::Cut& cut = patches_.drawn();
  renderer_->draw(camera, cut.patches, candidates_, cut.bound_px, shadingHere(), options, now, patches_.occluders(),
                  cut.patch_bound_px, proxyErrors());
}

std::vector<ProxyError> Viewer::proxyErrors() const {
  const lod::patch::Hierarchy& hierarchy = session_.hierarchy();
  std::vector<ProxyError> errors;
  for (const std::uint32_t number : patches_.drawn().patches) {
    const lod::patch::Patch& patch = hierarchy.patches[number];
    errors.push_back({patch.own_typical_error,
                      lod::patch::typicalColorErrorOf(patch, renderer_->patches().meanEdge(number)),
                      patch.color_detail != 0});
  }
  return errors;
}

// ---- samples and pixels ----

/// Returns the effort for the next picture. The last picture of a view at rest gets all; those that another soon
/// follows get what frame times allow, but all of its pixels and images where nobody moves.
DrawEffort Viewer::effortWanted(bool moved, double now) const {
  if (options_.effort) return *options_.effort;
  const bool fades = options_.lumigraph.fade_seconds > 0.0F;
  const bool passing = more_to_do_ || !hasAll() || (fades && (moved || settling()));
  if (!passing) return effortAtRest();
  const DrawEffort effort = governor_.whileMoving();
  const bool moves = fades && (moved || now - moved_at_ < kMotionSeconds);
  return moves ? effort : DrawEffort{.samples = effort.samples};
}

/// Whether the surface that a view a little beside this one shows will do for the choice of images.
bool Viewer::looksRoughly(double now) const {
  return options_.lumigraph.fade_seconds > 0.0F && now - moved_at_ < kMotionSeconds;
}

/// Whether the view has what it needs, but perhaps what refines it.
bool Viewer::hasAll() const {
  return session_.complete() || session_.refined();
}

/// The mean of twice as many pictures as a moving view has samples.
DrawEffort Viewer::effortAtRest() const {
  const int most = governor_.mostSamples();
  return {.pictures = most > 1 ? std::min(2 * most, PictureMean::kMostPictures) : 1};
}

/// Whether the memory's plan has room to blend each pixel of such a picture once. `samples`: those of a target of its
/// own, 0 without one.
bool Viewer::blendsOnce(int width, int height, int samples) const {
  const std::uint64_t target = samples > 0 ? base::gl::MultisampledTarget::bytesOf(width, height, samples) : 0;
  return LumigraphRenderer::bytesToBlendOnce(width, height) + target <= plan_.smaller_picture;
}

/// Returns as much of the effort as the memory's plan and the GL have room for. Blending each pixel once is worth more
/// than the last of the samples.
DrawEffort Viewer::fittingEffort(DrawEffort wanted) const {
  using base::gl::MultisampledTarget;
  if (wanted.pictures > 1) {
    const std::uint64_t once = LumigraphRenderer::bytesToBlendOnce(camera_.width, camera_.height);
    if (!mean_refused_ && once + PictureMean::bytesOf(camera_.width, camera_.height) <= plan_.samples) return wanted;
    wanted.samples = std::exchange(wanted.pictures, 1);
  }
  const bool once = blendsOnce(camera_.width, camera_.height, std::min(wanted.samples, kEnoughSamples));
  const auto fits = [&](int samples) {
    if (once) return blendsOnce(camera_.width, camera_.height, samples);
    return MultisampledTarget::bytesOf(camera_.width, camera_.height, samples) <= plan_.samples;
  };
  GLint most = 1;
  glGetIntegerv(GL_MAX_SAMPLES, &most);
  if (target_refused_) wanted.samples = 1, wanted.scale = 1.0F;
  while (wanted.samples > 1 && (wanted.samples > most || plan_.samples == 0 || !fits(wanted.samples)))
    wanted.samples /= 2;
  if (wanted.scale < 1.0F) {
    const auto whole = static_cast<float>(MultisampledTarget::bytesOf(camera_.width, camera_.height, 1));
    wanted.scale = std::min(wanted.scale, std::sqrt(static_cast<float>(plan_.smaller_picture) / whole));
  }
  return wanted;
}

/// Makes a target of this size with the effort's samples the one to draw into. False where the picture's own will do,
/// or the GL refuses.
bool Viewer::bindTarget(int width, int height, const DrawEffort& effort) {
  if (effort.samples <= 1 && effort.scale >= 1.0F) return false;
  if (!picture_.fits(width, height, effort.samples)) {
    picture_ = {};
    if (mean_) mean_->release();
    auto made = base::gl::MultisampledTarget::create(width, height, effort.samples);
    target_refused_ = !made;
    if (!made) {
      fault(made.error().message);
      return false;
    }
    picture_ = std::move(*made);
  }
  picture_.bind();
  return true;
}

/// Returns the options with which each picture of a mean is drawn.
LumigraphOptions Viewer::optionsAtRest(LumigraphOptions options) const {
  options.max_points_a_patch = effortAtRest().points;
  options.tuning.sharpen += kSharperMeans;
  options.tuning.footprint = kFootprintOfMeans;
  return options;
}

/// Draws pictures of the mean, and shows it, or the one before until this one is whole. Lessens effort.pictures to
/// those that are shown.
void Viewer::drawMean(const LumigraphOptions& options, DrawEffort& effort, GLuint target, double now) {
  const int wanted = std::exchange(effort.pictures, beginMean(options, effort.pictures, now));
  LumigraphOptions shifted = options;
  while (mean_->pictures() < effort.pictures) {
    shifted.shift = PictureMean::shiftOf(mean_->pictures(), wanted);
    mean_->beginPicture();
    drawProxy(camera_, shifted, now);
    mean_->addPicture();
  }
  const bool spoiled = settling();  // what has just begun to fade in shows in none of these pictures
  if (!spoiled && mean_->pictures() == wanted) mean_->dropKept();
  shows_older_ = mean_->kept() > 0;
  if (shows_older_) effort.pictures = mean_->kept();
  showMean(target);
  if (spoiled) mean_->restart();
}

/// Whether a finished mean of this look is here, perhaps of older data.
bool Viewer::hasMean(const LumigraphOptions& options) const {
  if (!mean_ || options_.lumigraph.fade_seconds <= 0.0F) return false;
  const Look look{view_, options, shading_, resting_.look.pictures};
  const bool is_whole = look.pictures > 0 && mean_->pictures() == look.pictures;
  return look == resting_.look && (mean_->kept() > 0 || is_whole);
}

void Viewer::showMean(GLuint target) {
  mean_->beginPicture();
  probePins();
  mean_->resolveTo(target);
}

/// Whether finer patches wait until the mean of what was here before is whole, since each would begin it anew, or until
/// that has been shown for a while.
bool Viewer::isFrozen(double now) const {
  if (!session_.refined() || !mean_ || mean_->pictures() == 0 || options_.lumigraph.fade_seconds <= 0.0F) return false;
  if (!base::showsSameView(resting_.look.view, view_)) return false;
  if (mean_->pictures() < resting_.look.pictures) return true;
  return !session_.complete() && now - resting_since_ < kRenewSeconds;
}

/// Begins a mean, unless the last one was of the same view drawn from the same. Returns how many pictures it shall have
/// now, of so many that are wanted in the end: all where a moving view has all effort or the picture must be final,
/// else one more, so that a slow machine answers between them.
int Viewer::beginMean(const LumigraphOptions& options, int wanted, double now) {
  Resting resting{{view_, options, shading_, wanted}, patches_.drawn().patches, patches_.occluders(), candidates_};
  if (resting != resting_) {
    if (resting.look != resting_.look)
      mean_->dropKept();
    else if (mean_->pictures() == wanted)
      mean_->keep();
    mean_->restart();
    resting_ = std::move(resting);
    resting_since_ = now;
  }
  const bool at_once = options.fade_seconds <= 0.0F || options_.effort || governor_.isAtMost();
  return at_once ? wanted : std::min(wanted, mean_->pictures() + 1);
}

/// Makes room for means of pictures. False where the GL refuses.
bool Viewer::prepareMean() {
  picture_ = {};
  const auto prepare = [this]() -> base::Result<void> {
    if (!mean_) {
      LUMIGRID_ASSIGN_OR_RETURN(auto made, PictureMean::create());
      mean_ = std::move(made);
    }
    return mean_->prepare(camera_.width, camera_.height);
  };
  const auto prepared = prepare();
  mean_refused_ = !prepared;
  if (!prepared) fault(prepared.error().message);
  return !mean_refused_;
}

/// Whether another picture of this view would have more samples, pixels or images, with nothing else to be done. A
/// frame shown whole needs none.
bool Viewer::effortPending() const {
  if (!renderer_ || options_.effort || frame_.shown() || more_to_do_ || settling()) return false;
  if (effort_.scale < 1.0F || effort_.points < kMaxBlended) return true;
  const DrawEffort rest = fittingEffort(effortAtRest());
  return session_.complete() && (effort_.samples < rest.samples || effort_.pictures < rest.pictures);
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

/// A server's frame shows the model as it is, in perspective, with the view's section: whatever else alters the picture
/// here is missing in it.
bool Viewer::mayShowFrames() const {
  const lod::draw::ViewModes& modes = options_.lumigraph.modes;
  return options_.lumigraph.use_images && !modes.resolution_colors && !modes.hasLight() &&
         !options_.lumigraph.show_disagreement && !view_.orthographic();
}

bool Viewer::showsThisView(SampleId id) const {
  if ((id & kFrameTag) == 0) return false;
  const protocol::Frame* frame = session_.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
  return frame != nullptr && base::showsSameView(frame->camera, view_);
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
