#include "client/app/app.h"
#include "client/app/splat_settings.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/app/app_impl.h"
#include "client/app/permalink.h"

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
  viewer.session.max_triangles = static_cast<std::uint32_t>(s.max_triangles);
  viewer.session.max_points = static_cast<std::uint16_t>(s.points);
  viewer.lumigraph.max_samples = static_cast<int>(s.samples);
  viewer.session.images = s.images != 0.0;
  viewer.session.frames = s.frames != 0.0;
  viewer.lumigraph.use_images = viewer.session.images || viewer.session.frames;
  return viewer;
}

bool isNotFinite(double value) {
  return !std::isfinite(value);
}

}  // namespace

// ---- construction and events ----

App::Impl::Impl(const AppOptions& wanted, std::unique_ptr<ImageDecoder> decoder)
    : options(wanted), settings(wanted.settings), viewer(viewerOptions(wanted), std::move(decoder)) {
  view.method = viewer.options().method;
  control.setFov(glm::radians(settings.fov_degrees));
}

App::App(const AppOptions& options, std::unique_ptr<ImageDecoder> decoder)
    : impl_(std::make_unique<Impl>(options, std::move(decoder))) {}
App::~App() = default;

Session& App::session() {
  return impl_->viewer.session();
}
Viewer& App::viewer() {
  return impl_->viewer;
}

void App::resize(int width_px, int height_px, double pixel_ratio) {
  Impl& s = *impl_;
  const int width = std::clamp(width_px, 0, protocol::kMaxViewport);
  const int height = std::clamp(height_px, 0, protocol::kMaxViewport);
  const double ratio = pixel_ratio > 0.0 && pixel_ratio < 100.0 ? pixel_ratio : 1.0;
  if (width == s.width && height == s.height && ratio == s.pixel_ratio) return;
  s.width = width;
  s.height = height;
  s.pixel_ratio = ratio;
  s.gestures.setPixelRatio(ratio);
  if (width == 0 || height == 0) return;
  s.control.setViewport(width, height);
  s.frameNewScene();
  s.cameraMoved();
}

void App::pointerDown(const PointerEvent& event) {
  Impl& s = *impl_;
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return;
  if (!s.gestures.anyDown() && (s.grabHandle(event) || s.grabLens(event))) return;
  s.gestures.down(event);
}

void App::pointerMove(const PointerEvent& event) {
  Impl& s = *impl_;
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return;
  if (event.id == s.handle_pointer) return s.dragHandle(event);
  if (event.id == s.lens_pointer) return s.dragLens(event);
  for (const Gesture& gesture : s.gestures.move(event)) s.applyGesture(gesture);
}

void App::pointerUp(const PointerEvent& event) {
  Impl& s = *impl_;
  if (isNotFinite(event.x) || isNotFinite(event.y) || isNotFinite(event.now)) return pointerCancel(event.id);
  if (event.id == s.handle_pointer || event.id == s.lens_pointer) return pointerCancel(event.id);
  for (const Gesture& gesture : s.gestures.up(event)) s.applyGesture(gesture);
}

void App::pointerCancel(int id) {
  if (id == impl_->handle_pointer) impl_->handle_pointer = -1;
  if (id == impl_->lens_pointer) impl_->lens_pointer = -1;
  impl_->gestures.cancel(id);
}

void App::turnWheel(double steps, double x, double y, double now) {
  if (isNotFinite(steps) || isNotFinite(x) || isNotFinite(y) || isNotFinite(now)) return;
  impl_->now = std::max(impl_->now, now);
  impl_->zoom(std::clamp(steps, -20.0, 20.0), x, y);
}

bool App::handleKey(Key key, bool down, Modifiers modifiers, double now) {
  Impl& s = *impl_;
  if (!isNotFinite(now)) s.now = std::max(s.now, now);
  bool& held = s.held[static_cast<std::size_t>(key)];
  s.shift = key == Key::kShift ? down : modifiers.shift;
  if (!down) return std::exchange(held, false);
  if (key == Key::kNone || key == Key::kShift) return false;

  const bool arrow = key >= Key::kUp && key <= Key::kRight;
  const bool moves = (key >= Key::kW && key <= Key::kRight) || key == Key::kPlus || key == Key::kMinus ||
                     ((key == Key::kPageUp || key == Key::kPageDown) && s.view.section.on);
  if (moves) {
    if (modifiers.alt || (modifiers.ctrl && !arrow)) return false;
    s.turning = modifiers.ctrl;
    held = true;
    return true;
  }
  if (held) return true;  // a repeated press
  const bool taken = s.pressKey(key, modifiers);
  held = taken;
  return taken;
}

void App::blur() {
  Impl& s = *impl_;
  s.held.fill(false);
  s.shift = false;
  s.gestures.cancelAll();
  s.handle_pointer = -1;
  s.lens_pointer = -1;
}

void App::setHidden(bool hidden) {
  Impl& s = *impl_;
  if (hidden) blur();
  if (!hidden && s.hidden) {
    s.dirty = true;
    s.started = false;  // no motion happens in the time between
  }
  s.hidden = hidden;
}

void App::setReducedMotion(bool system_wants) {
  impl_->system_reduces_motion = system_wants;
}

void App::contextLost() {
  impl_->viewer.contextLost();
}

base::Result<void> App::contextRestored() {
  impl_->dirty = true;
  impl_->pins_changed = true;
  return impl_->viewer.contextRestored();
}

// ---- the loop ----

void App::advance(double now) {
  impl_->advanceTo(now);
}

bool App::wantsFrame() const {
  const Impl& s = *impl_;
  if (!s.drawable()) return false;
  if (s.dirty || s.flight.active() || s.flying()) return true;
  const ViewerStats stats = s.viewer.stats();
  return stats.busy || stats.session.messages_received != s.drawn_messages;
}

base::Result<void> App::drawFrame(double now) {
  Impl& s = *impl_;
  s.advanceTo(now);
  if (!s.drawable()) return {};
  const double begin = s.options.clock ? s.options.clock() : 0.0;
  s.drawn_messages = s.viewer.session().stats().messages_received;
  if (!s.ready()) {
    // The first view is chosen when the scene is known; a server that heard of any other would send images for it.
    s.viewer.drawBackground();
    s.dirty = false;
    return {};
  }
  s.configureViewer();
  LUMIGRID_TRY(s.viewer.draw(s.drawnCamera(), s.now));
  if (s.options.clock) s.draw_seconds += 0.2 * (s.options.clock() - begin - s.draw_seconds);
  s.frame_rate.add(s.now, 1.0);

  // Count how many of the images that a moving view uses had to be fetched.
  const ViewerStats stats = s.viewer.stats();
  const std::uint64_t images = stats.session.faces_received + stats.session.frames_received;
  s.images_came += static_cast<double>(images - s.seen_images);
  s.seen_images = images;
  if (s.moved_since_frame) s.images_used += stats.lumigraph.samples_used;
  s.moved_since_frame = false;
  s.dirty = false;
  s.readPinAnswers();
  s.refreshOverlay();
  ++s.overlay_version;
  return {};
}

// ---- requests ----

std::vector<Request> App::takeRequests() {
  return std::exchange(impl_->requests, {});
}

void App::answerPick(std::uint32_t id, const PickAnswer& answer) {
  Impl& s = *impl_;
  PickAnswer taken = answer;
  if (taken.kind == PickAnswer::Kind::kHit && (isNotFinite(glm::dot(taken.point, taken.point)) ||
                                               isNotFinite(taken.accuracy) || s.hiddenBySection(taken.point)))
    taken.kind = PickAnswer::Kind::kUnknown;
  if (!s.measure.answer(id, taken)) return;
  s.dirty = true;
  s.overlayChanged();
}

void App::showToast(std::string text, bool error) {
  impl_->showToast(std::move(text), error);
}

// ---- state ----

const ViewState& App::view() const {
  return impl_->view;
}
std::string App::permalink() const {
  return formatPermalink(impl_->view);
}

bool App::lensShown() const {
  return impl_->lens.has_value();
}

void App::showStatistics(bool shown) {
  impl_->view.statistics = shown;
  impl_->overlayChanged();
}

void App::setBackground(const std::array<float, 4>& color) {
  impl_->viewer.setBackground(color);
  impl_->dirty = true;
}

base::Result<void> App::openPermalink(std::string_view text) {
  Impl& s = *impl_;
  auto wanted = parsePermalink(text);
  if (!wanted) {
    s.showToast(wanted.error().message, true);
    return wanted.error();
  }
  if ((wanted->method == Method::kQsplat) != (s.view.method == Method::kQsplat)) {
    const base::Error error{base::ErrorCode::kUnsupported,
                            "this link is for another method, whose data come from another place; open it anew"};
    s.showToast(error.message, true);
    return error;
  }
  s.last_link = formatPermalink(*wanted);
  if (s.ready())
    s.showView(*wanted, true, false);
  else
    s.wanted_view = *wanted;
  return {};
}

const std::string& App::bookmark(int slot) const {
  LUMIGRID_CHECK(slot >= 0 && slot < kBookmarks);
  return impl_->bookmarks[static_cast<std::size_t>(slot)];
}

base::Result<void> App::setBookmark(int slot, std::string_view permalink) {
  if (slot < 1 || slot >= kBookmarks)
    return base::Error{base::ErrorCode::kInvalidInput, "bookmarks are numbered from 1 to 9"};
  if (!permalink.empty()) {
    const auto parsed = parsePermalink(permalink);
    if (!parsed) return base::within("bookmark " + std::to_string(slot), parsed.error());
  }
  impl_->bookmarks[static_cast<std::size_t>(slot)] = permalink;
  return {};
}

const Settings& App::settings() const {
  return impl_->settings;
}

base::Result<void> App::changeSetting(std::string_view name, double value) {
  Impl& s = *impl_;
  const Settings before = s.settings;
  LUMIGRID_TRY(setSetting(s.settings, name, value));
  if (s.settings == before) return {};
  if (s.settings.fov_degrees != before.fov_degrees) {
    s.control.setFov(glm::radians(s.settings.fov_degrees));
    s.cameraMoved();
  }
  if (SplatView* splats = s.viewer.splats()) {
    SplatQuality quality = splats->quality();
    applyChanges(before, s.settings, quality);
    if (quality != splats->quality()) {
      splats->setQuality(quality);
      s.dirty = true;
    }
  }
  s.requests.push_back({.kind = RequestKind::kKeepSettings});
  s.overlayChanged();
  return {};
}

void App::setAnnotations(std::vector<Annotation> annotations) {
  Impl& s = *impl_;
  if (annotations.size() > kMaxAnnotations) {
    annotations.resize(kMaxAnnotations);
    s.showToast("Only the first " + std::to_string(kMaxAnnotations) + " notes are shown", true);
  }
  s.annotations = std::move(annotations);
  s.open_annotation.reset();
  s.pins_visible.clear();
  s.pins_changed = true;
  s.dirty = true;
  s.overlayChanged();
}

const std::vector<Annotation>& App::annotations() const {
  return impl_->annotations;
}

// ---- the overlay ----

std::uint64_t App::overlayVersion() const {
  return impl_->overlay_version;
}
const std::vector<Label>& App::labels() const {
  return impl_->labels;
}
const std::vector<LabelLine>& App::lines() const {
  return impl_->lines;
}
const std::vector<Toast>& App::toasts() const {
  return impl_->toasts;
}
Status App::status() const {
  return impl_->status();
}
Progress App::progress() const {
  return impl_->progress;
}
Mode App::mode() const {
  return impl_->mode;
}

std::string App::modeHint() const {
  if (impl_->mode == Mode::kDistance)
    return "Distance: click point after point, double click ends. Enter takes the middle. M: angles. Escape: done.";
  if (impl_->mode == Mode::kAngle)
    return "Angle: click one arm's end, the corner, the other arm's end. Backspace takes one back. Escape: done.";
  return "";
}

bool App::helpShown() const {
  return impl_->help;
}

void App::showHelp(bool shown) {
  if (impl_->help != shown) impl_->overlayChanged();
  impl_->help = shown;
}

std::optional<std::size_t> App::openAnnotation() const {
  return impl_->open_annotation;
}
void App::showAnnotation(std::optional<std::size_t> index) {
  impl_->openCard(index);
}
const std::vector<Measurement>& App::measurements() const {
  return impl_->measure.all();
}

const std::string& App::unit() const {
  static const std::string kUnknown;
  return impl_->framed ? impl_->framed->units : kUnknown;
}
std::string App::sceneName() const {
  return impl_->framed ? impl_->framed->scene_name : "";
}
base::ViewCamera App::camera() const {
  return impl_->drawnCamera();
}

Statistics App::statistics() const {
  const Impl& s = *impl_;
  Statistics out;
  out.viewer = s.viewer.stats();
  out.frames_per_second = s.frame_rate.perSecond(s.now);
  out.frame_milliseconds = 1e3 * s.draw_seconds;
  out.megabits_per_second = 8e-6 * s.byte_rate.perSecond(s.now);
  out.round_trip_milliseconds = 1e3 * s.round_trip.seconds();
  const double asked = s.images_used + s.images_came;
  out.hit_rate = asked > 0.0 ? s.images_used / asked : 0.0;
  return out;
}

}  // namespace client
