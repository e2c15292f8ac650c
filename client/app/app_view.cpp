#include "client/app/app.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/app/permalink.h"

namespace client {
namespace {

// The speeds and times here are choices of design.

/// Longest step of motion that one turn of the loop makes, so that a pause causes no jump.
constexpr double kMaxStep = 0.1;  // seconds
/// Flying speed in pivot distances per second, and its factor with shift.
constexpr double kFlySpeed = 0.6;
constexpr double kShiftFactor = 4.0;
/// Speed of turning by keys, in view heights (half a turn each) per second, and of zooming by keys, in wheel steps per
/// second.
constexpr double kTurnSpeed = 0.4;
constexpr double kZoomKeySpeed = 5.0;
/// Time in which the section plane crosses the model while a key is held.
constexpr double kSectionSeconds = 6.0;
/// The view counts as at rest when nothing has moved for this long.
constexpr double kRestSeconds = 0.4;

bool sameShape(const protocol::Welcome& a, const protocol::Welcome& b) {
  return a.scene_name == b.scene_name && a.origin == b.origin && a.box_min == b.box_min && a.box_max == b.box_max;
}

}  // namespace

// ---- the camera and the viewer ----

/// Every drawn camera is made here.
base::ViewCamera App::camera() const {
  base::ViewCamera camera = control_.camera();
  camera.ortho_height = control_.orthoHeight();
  camera.section = view_.section.plane();
  return camera;
}

/// The viewer is configured only here.
void App::configureViewer() {
  viewer_.setMethod(view_.method);
  viewer_.setResolutionColors(view_.colors_by_resolution);
  viewer_.setLight(view_.light.on ? std::optional(view_.light.direction()) : std::nullopt);
  if (StreamedView* view = viewer_.streamed(); view != nullptr && view->quality().shadows != view_.shadows) {
    StreamedQuality quality = view->quality();
    quality.shadows = view_.shadows;
    view->setQuality(quality);
  }
  std::optional<lod::qsplat::Lens> glass;
  if (lens_) glass = {glm::vec2(*lens_), static_cast<float>(lensRadius())};
  viewer_.setLens(glass);
  if (!std::exchange(pins_changed_, false)) return;
  std::vector<glm::dvec3> pins;
  for (const Annotation& annotation : annotations_) pins.push_back(annotation.position);
  viewer_.setPins(std::move(pins));
}

std::optional<glm::dvec3> App::surfaceAt(double x, double y) {
  if (!ready()) return std::nullopt;
  return options_.surface ? options_.surface(camera(), x, y) : viewer_.surfaceAt(camera(), x, y);
}

/// Marks the overlay as changed.
void App::overlayChanged() {
  overlay_dirty_ = true;
  ++overlay_version_;
}

void App::cameraMoved() {
  const Viewpoint place = control_.viewpoint();
  view_.position = place.position;
  view_.direction = place.direction;
  view_.pivot_distance = place.distance;
  view_.fov_y = control_.camera().fov_y;
  view_.orthographic = control_.orthographic();
  dirty_ = true;
  moved_since_frame_ = true;
  last_motion_ = now_;
  overlayChanged();
}

/// Chooses the first view of a scene, and of another scene that took its place after a reconnect.
void App::frameNewScene() {
  const protocol::Welcome* welcome = viewer_.session().welcome();
  if (welcome == nullptr || width_ <= 0 || (framed_ && sameShape(*framed_, *welcome))) return;
  const bool another = framed_.has_value();
  framed_ = *welcome;
  flight_.end();
  control_.frameScene(*welcome);
  if (another) {
    measure_.clear();
    view_.section.on = false;
    bookmarks_ = {};
  }
  cameraMoved();
  if (wanted_view_) return showView(*std::exchange(wanted_view_, std::nullopt), true, false);
  // The method is the viewer's own matter. A text that a later program wrote leaves the whole model in view.
  if (welcome->start_view.empty()) return;
  if (const auto first = parsePermalink(welcome->start_view)) showView(*first, false, false);
}

void App::moveTo(const Viewpoint& place, bool glide) {
  flight_.end();
  if (glide && !reducedMotion())
    flight_.begin(control_.viewpoint(), place, now_);
  else
    control_.setViewpoint(place);
  cameraMoved();
}

/// Shows a link's view. `whole` includes what is no part of a viewpoint: the method and the statistics.
void App::showView(const ViewState& wanted, bool whole, bool glide) {
  control_.setFov(wanted.fov_y);
  control_.setOrthographic(wanted.orthographic);
  view_.section = wanted.section;
  view_.light = wanted.light;
  view_.colors_by_resolution = wanted.colors_by_resolution;
  if (whole) {
    view_.method = wanted.method;
    setShadows(wanted.shadows);
    view_.statistics = wanted.statistics;
  }
  if (wanted.pivot_distance <= 0.0) return cameraMoved();
  moveTo({wanted.position, wanted.direction, wanted.pivot_distance}, glide);
}

// ---- motion by keys ----

bool App::flying() const {
  static constexpr std::array<Key, 14> kMoving{Key::kW,    Key::kA,     Key::kS,      Key::kD,       Key::kQ,
                                               Key::kE,    Key::kUp,    Key::kDown,   Key::kLeft,    Key::kRight,
                                               Key::kPlus, Key::kMinus, Key::kPageUp, Key::kPageDown};
  return std::any_of(kMoving.begin(), kMoving.end(), [this](Key key) { return held_[static_cast<std::size_t>(key)]; });
}

void App::fly(double seconds) {
  const auto down = [this](Key key) { return held_[static_cast<std::size_t>(key)] ? 1.0 : 0.0; };
  const double speed = seconds * (shift_ ? kShiftFactor : 1.0);
  const double right = down(Key::kRight) - down(Key::kLeft);
  const double forward = down(Key::kUp) - down(Key::kDown);

  // The arrows fly, or turn when ctrl is down.
  glm::dvec3 direction(down(Key::kD) - down(Key::kA), down(Key::kE) - down(Key::kQ), down(Key::kW) - down(Key::kS));
  if (turning_) {
    const double pixels = kTurnSpeed * speed * settings_.orbit_speed * height_;
    if (right != 0.0 || forward != 0.0) control_.orbit(-pixels * right, pixels * forward);
  } else {
    direction += glm::dvec3(right, 0.0, forward);
  }
  if (direction != glm::dvec3(0.0)) control_.fly(kFlySpeed * settings_.fly_speed * speed * direction);

  const double steps = kZoomKeySpeed * speed * (down(Key::kPlus) - down(Key::kMinus));
  if (steps != 0.0) control_.zoom(steps, 0.5 * width_, 0.5 * height_, std::nullopt);

  const double along = down(Key::kPageUp) - down(Key::kPageDown);
  if (along != 0.0 && view_.section.on)
    moveSection(along * speed / kSectionSeconds * (control_.boxMax() - control_.boxMin())[view_.section.axis]);
  cameraMoved();
}

// ---- time ----

bool App::atRest() const {
  return !flight_.active() && !flying() && !gestures_.anyDown() && now_ - last_motion_ >= kRestSeconds;
}

void App::reportRest() {
  if (!ready() || !atRest()) return;
  std::string link = formatPermalink(view_);
  if (link == last_link_) return;
  last_link_ = link;
  requests_.push_back({.kind = RequestKind::kLinkChanged, .text = std::move(link)});
}

void App::updateMeters() {
  const SessionStats stats = viewer_.stats().session;
  byte_rate_.add(now_, static_cast<double>(stats.bytes_received - seen_bytes_));
  seen_bytes_ = stats.bytes_received;
  round_trip_.update(now_, stats.messages_received, stats.views_sent);
}

/// Advances the clock and everything that depends on it.
void App::advance(double time) {
  if (!std::isfinite(time)) return;
  const double step = started_ ? std::clamp(time - now_, 0.0, kMaxStep) : 0.0;
  started_ = true;
  now_ = std::max(now_, time);
  frameNewScene();
  if (hidden_) return;
  if (ready() && flight_.active()) {
    control_.setViewpoint(flight_.at(control_, now_));
    cameraMoved();
  }
  if (ready() && flying() && step > 0.0) {
    flight_.end();
    fly(step);
  }
  updateMeters();
  expireToasts();
  updateProgress();
  readPinAnswers();
  reportRest();
  if (overlay_dirty_) refreshOverlay();
}

}  // namespace client
