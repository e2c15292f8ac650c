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
  frame_.update(framesOfThisView(), moved, options_.lumigraph.fade_seconds > 0.0F, now);
  drawBlended(now);
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
void Viewer::drawBlended(double now) {
  candidates_.clear();
  for (SampleId id : ranked_)
    if (images_[id].state == ImageState::kResident) candidates_.push_back(id);
  LumigraphOptions options = options_.lumigraph;
  options.modes.section = sectionHere();
  const bool hidden = frame_.whole() || frame_.under();
  options.unseen = options.unseen || (hidden && !probe_);
  const lod::patch::Cut& cut = patches_.drawn();
  renderer_->draw(camera_, cut.patches, candidates_, cut.bound_px, shading_, options, now, patches_.occluders(),
                  cut.patch_bound_px);
  if (!options.unseen) probePins();
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
