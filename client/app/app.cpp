#include "client/app/app.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/app/permalink.h"
#include "client/app/streamed_settings.h"

namespace client {
namespace {

/// Returns the viewer's options, with the settings applied to them.
ViewerOptions viewerOptions(const AppOptions& options) {
  ViewerOptions viewer = options.viewer;
  if (!options.apply_settings) return viewer;
  const Settings& s = options.settings;
  viewer.session.cache_bytes = static_cast<std::uint64_t>(s.cache_megabytes * 1e6);
  viewer.gpu_budget_bytes = static_cast<std::uint64_t>(s.gpu_megabytes * 1e6);
  viewer.memory_budget_bytes = static_cast<std::uint64_t>(s.memory_megabytes * 1e6);
  viewer.session.patch_tolerance_px = static_cast<float>(s.patch_tolerance);
  viewer.session.alone_tolerance_px = static_cast<float>(s.alone_tolerance);
  viewer.session.guarantee = s.guarantee != 0.0;
  viewer.session.max_triangles = static_cast<std::uint32_t>(s.max_triangles);
  viewer.session.max_points = static_cast<std::uint16_t>(s.points);
  viewer.lumigraph.max_samples = static_cast<int>(s.samples);
  viewer.session.images = s.images != 0.0;
  viewer.session.frames = s.frames != 0.0;
  viewer.session.refine = s.refine != 0.0;
  viewer.samples = s.antialias != 0.0 ? viewer.samples : 1;
  viewer.fps = s.fps;
  viewer.lumigraph.use_images = viewer.session.images || viewer.session.frames;
  return viewer;
}

bool isNotFinite(double value) {
  return !std::isfinite(value);
}

}  // namespace

// ---- construction and events ----

App::App(const AppOptions& options, std::unique_ptr<ImageDecoder> decoder)
    : options_(options), settings_(options.settings), viewer_(viewerOptions(options), std::move(decoder)) {
  view_.method = viewer_.options().method;
  view_.colors_by_resolution = options.viewer.lumigraph.modes.resolution_colors;
  view_.light = options.light;
  setShadows(options.apply_settings ? shadowsOf(settings_) : options.shadows);
  control_.setFov(glm::radians(settings_.fov_degrees));
}

void App::resize(int width_px, int height_px, double pixel_ratio) {
  const int width = std::clamp(width_px, 0, protocol::kMaxViewport);
  const int height = std::clamp(height_px, 0, protocol::kMaxViewport);
  const double ratio = pixel_ratio > 0.0 && pixel_ratio < 100.0 ? pixel_ratio : 1.0;
  if (width == width_ && height == height_ && ratio == pixel_ratio_) return;
  width_ = width;
  height_ = height;
  pixel_ratio_ = ratio;
  gestures_.setPixelRatio(ratio);
  if (width == 0 || height == 0) return;
  control_.setViewport(width, height);
  frameNewScene();
  cameraMoved();
}

void App::pointerDown(const PointerEvent& event) {
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return;
  if (!gestures_.anyDown() && (grabHandle(event) || grabLight(event) || grabLens(event))) return;
  gestures_.down(event);
}

void App::pointerMove(const PointerEvent& event) {
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return;
  if (event.id == handle_pointer_) return dragHandle(event);
  if (event.id == light_pointer_) return dragLight(event.x, event.y);
  if (event.id == lens_pointer_) return dragLens(event);
  for (const Gesture& gesture : gestures_.move(event)) applyGesture(gesture);
}

void App::pointerUp(const PointerEvent& event) {
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return pointerCancel(event.id);
  if (event.id == handle_pointer_) {
    handle_pointer_ = -1;
  } else if (event.id == light_pointer_) {
    light_pointer_ = -1;
  } else if (event.id == lens_pointer_) {
    lens_pointer_ = -1;
  } else {
    for (const Gesture& gesture : gestures_.up(event)) applyGesture(gesture);
  }
}

void App::pointerCancel(int id) {
  if (id == handle_pointer_) handle_pointer_ = -1;
  if (id == light_pointer_) light_pointer_ = -1;
  if (id == lens_pointer_) lens_pointer_ = -1;
  gestures_.cancel(id);
}

void App::turnWheel(double steps, double x, double y, double now) {
  if (isNotFinite(steps) || isNotFinite(x) || isNotFinite(y) || isNotFinite(now)) return;
  now_ = std::max(now_, now);
  zoom(std::clamp(steps, -20.0, 20.0), x, y);
}

bool App::handleKey(Key key, bool down, Modifiers modifiers, double now) {
  if (!isNotFinite(now)) now_ = std::max(now_, now);
  bool& held = held_[static_cast<std::size_t>(key)];
  shift_ = key == Key::kShift ? down : modifiers.shift;
  if (!down) return std::exchange(held, false);
  if (key == Key::kNone || key == Key::kShift) return false;

  const bool arrow = key >= Key::kUp && key <= Key::kRight;
  const bool moves = (key >= Key::kW && key <= Key::kRight) || key == Key::kPlus || key == Key::kMinus ||
                     ((key == Key::kPageUp || key == Key::kPageDown) && view_.section.on);
  if (moves) {
    if (modifiers.alt || (modifiers.ctrl && !arrow)) return false;
    turning_ = modifiers.ctrl;
    held = true;
    return true;
  }
  if (held) return true;  // a repeated press
  const bool taken = pressKey(key, modifiers);
  held = taken;
  return taken;
}

void App::blur() {
  held_.fill(false);
  shift_ = false;
  gestures_.cancelAll();
  handle_pointer_ = -1;
  light_pointer_ = -1;
  lens_pointer_ = -1;
}

void App::setHidden(bool hidden) {
  if (hidden) blur();
  if (!hidden && hidden_) {
    dirty_ = true;
    started_ = false;  // no motion happens in the time between
  }
  hidden_ = hidden;
}

base::Result<void> App::contextRestored() {
  dirty_ = true;
  pins_changed_ = true;
  return viewer_.contextRestored();
}

// ---- the loop ----

bool App::wantsFrame() const {
  if (!drawable()) return false;
  if (dirty_ || flight_.active() || flying()) return true;
  const ViewerStats stats = viewer_.stats();
  if (stats.effort_pending && !atRest()) return stats.session.messages_received != drawn_messages_;
  return stats.busy || stats.session.messages_received != drawn_messages_;
}

base::Result<void> App::drawFrame(double now) {
  advance(now);
  if (!drawable()) return {};
  const double begin = options_.clock ? options_.clock() : 0.0;
  drawn_messages_ = viewer_.session().stats().messages_received;
  if (!ready()) {
    // The first view is chosen when the scene is known; a server that heard of any other would send images for it.
    viewer_.drawBackground();
    dirty_ = false;
    return {};
  }
  configureViewer();
  // The interval between two pictures of a moving view is the time that the first took.
  if (moved_since_frame_ && frame_moved_) viewer_.addFrameTime(now_ - frame_at_);
  frame_moved_ = moved_since_frame_;
  frame_at_ = now_;
  LUMIGRID_TRY(viewer_.draw(camera(), now_));
  if (options_.clock) draw_seconds_ += 0.2 * (options_.clock() - begin - draw_seconds_);
  frame_rate_.add(now_, 1.0);

  // Count how many of the images that a moving view uses had to be fetched.
  const ViewerStats stats = viewer_.stats();
  const std::uint64_t images = stats.session.faces_received + stats.session.frames_received;
  images_came_ += static_cast<double>(images - seen_images_);
  seen_images_ = images;
  if (moved_since_frame_) images_used_ += stats.lumigraph.samples_used;
  moved_since_frame_ = false;
  dirty_ = false;
  readPinAnswers();
  refreshOverlay();
  ++overlay_version_;
  return {};
}

// ---- requests ----

void App::answerPick(std::uint32_t id, const PickAnswer& answer) {
  PickAnswer taken = answer;
  if (taken.kind == PickAnswer::Kind::kHit &&
      (isNotFinite(glm::dot(taken.point, taken.point)) || isNotFinite(taken.accuracy) || hiddenBySection(taken.point)))
    taken.kind = PickAnswer::Kind::kUnknown;
  if (!measure_.answer(id, taken)) return;
  dirty_ = true;
  overlayChanged();
}

// ---- state ----

std::string App::permalink() const {
  return formatPermalink(view_);
}

void App::showStatistics(bool shown) {
  view_.statistics = shown;
  overlayChanged();
}

void App::setBackground(const std::array<float, 4>& color) {
  viewer_.setBackground(color);
  dirty_ = true;
}

base::Result<void> App::openPermalink(std::string_view text) {
  auto wanted = parsePermalink(text);
  if (!wanted) {
    showToast(wanted.error().message, true);
    return wanted.error();
  }
  const bool another = isStreamed(wanted->method) || isStreamed(view_.method);
  if (another && wanted->method != view_.method) {
    const base::Error error{base::ErrorCode::kUnsupported,
                            "this link is for another method, whose data come from another place; open it anew"};
    showToast(error.message, true);
    return error;
  }
  last_link_ = formatPermalink(*wanted);
  if (ready())
    showView(*wanted, true, false);
  else
    wanted_view_ = *wanted;
  return {};
}

const std::string& App::bookmark(int slot) const {
  LUMIGRID_CHECK(slot >= 0 && slot < kBookmarks);
  return bookmarks_[static_cast<std::size_t>(slot)];
}

base::Result<void> App::setBookmark(int slot, std::string_view permalink) {
  if (slot < 1 || slot >= kBookmarks)
    return base::Error{base::ErrorCode::kInvalidInput, "bookmarks are numbered from 1 to 9"};
  if (!permalink.empty()) {
    const auto parsed = parsePermalink(permalink);
    if (!parsed) return base::within("bookmark " + std::to_string(slot), parsed.error());
  }
  bookmarks_[static_cast<std::size_t>(slot)] = permalink;
  return {};
}

base::Result<void> App::changeSetting(std::string_view name, double value) {
  const Settings before = settings_;
  LUMIGRID_TRY(setSetting(settings_, name, value));
  // A link or the command line may have chosen others meanwhile.
  if (name == "shadows" && view_.shadows != shadowsOf(settings_)) setShadows(shadowsOf(settings_));
  if (settings_ == before) return {};
  if (settings_.fov_degrees != before.fov_degrees) {
    control_.setFov(glm::radians(settings_.fov_degrees));
    cameraMoved();
  }
  if (StreamedView* view = viewer_.streamed()) {
    StreamedQuality quality = view->quality();
    applyChanges(before, settings_, quality);
    if (quality != view->quality()) {
      view->setQuality(quality);
      dirty_ = true;
    }
  }
  requests_.push_back({.kind = RequestKind::kKeepSettings});
  overlayChanged();
  return {};
}

void App::setShadows(lod::hlod::Shadows shadows) {
  if (view_.method != Method::kHlod) return;
  view_.shadows = shadows;
  dirty_ = true;
}

void App::setAnnotations(std::vector<Annotation> annotations) {
  if (annotations.size() > kMaxAnnotations) {
    annotations.resize(kMaxAnnotations);
    showToast("Only the first " + std::to_string(kMaxAnnotations) + " notes are shown", true);
  }
  annotations_ = std::move(annotations);
  open_annotation_.reset();
  pins_visible_.clear();
  pins_changed_ = true;
  dirty_ = true;
  overlayChanged();
}

// ---- the overlay ----

std::string App::modeHint() const {
  if (mode_ == Mode::kDistance)
    return "Distance: click point after point, double click ends. Enter takes the middle. M: angles. Escape: done.";
  if (mode_ == Mode::kAngle)
    return "Angle: click one arm's end, the corner, the other arm's end. Backspace takes one back. Escape: done.";
  return "";
}

void App::showHelp(bool shown) {
  if (help_ != shown) overlayChanged();
  help_ = shown;
}

const std::string& App::unit() const {
  static const std::string kUnknown;
  return framed_ ? framed_->units : kUnknown;
}

std::optional<double> App::northTurn() const {
  if (!framed_ || framed_->north == glm::vec3(0.0F)) return std::nullopt;
  const base::ViewCamera view = control_.camera();
  const glm::dvec3 right = glm::cross(view.direction, view.up);
  const glm::dvec3 ahead = glm::cross(glm::dvec3(framed_->up), right);
  const glm::dvec3 north(framed_->north);
  return std::atan2(glm::dot(north, right), glm::dot(north, ahead));
}

Statistics App::statistics() const {
  Statistics out;
  out.viewer = viewer_.stats();
  out.frames_per_second = frame_rate_.perSecond(now_);
  out.frame_milliseconds = 1e3 * draw_seconds_;
  out.megabits_per_second = 8e-6 * byte_rate_.perSecond(now_);
  out.round_trip_milliseconds = 1e3 * round_trip_.seconds();
  const double asked = images_used_ + images_came_;
  out.hit_rate = asked > 0.0 ? images_used_ / asked : 0.0;
  return out;
}

}  // namespace client
