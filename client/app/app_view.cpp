#include "client/app/app_impl.h"

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
base::ViewCamera App::Impl::drawnCamera() const {
  base::ViewCamera camera = control.camera();
  camera.ortho_height = control.orthoHeight();
  return camera;
}

/// The viewer is configured only here.
void App::Impl::configureViewer() {
  viewer.setMethod(view.method);
  viewer.setResolutionColors(view.colors_by_resolution);
  std::optional<lod::qsplat::Lens> glass;
  if (lens) glass = {glm::vec2(*lens), static_cast<float>(lensRadius())};
  viewer.setLens(glass);
  std::optional<base::SectionPlane> plane;
  if (view.section.on) {
    const double side = view.section.keep_below ? 1.0 : -1.0;
    plane.emplace();
    plane->normal = glm::dvec3(0.0);
    plane->normal[view.section.axis] = side;
    plane->offset = side * view.section.offset;
  }
  viewer.setSection(plane);
  if (!std::exchange(pins_changed, false)) return;
  std::vector<glm::dvec3> pins;
  for (const Annotation& annotation : annotations) pins.push_back(annotation.position);
  viewer.setPins(std::move(pins));
}

std::optional<glm::dvec3> App::Impl::surfaceAt(double x, double y) {
  if (!ready()) return std::nullopt;
  return options.surface ? options.surface(drawnCamera(), x, y) : viewer.surfaceAt(drawnCamera(), x, y);
}

/// Marks the overlay as changed.
void App::Impl::overlayChanged() {
  overlay_dirty = true;
  ++overlay_version;
}

void App::Impl::cameraMoved() {
  const Viewpoint place = control.viewpoint();
  view.position = place.position;
  view.direction = place.direction;
  view.pivot_distance = place.distance;
  view.fov_y = control.camera().fov_y;
  view.orthographic = control.orthographic();
  dirty = true;
  moved_since_frame = true;
  last_motion = now;
  overlayChanged();
}

/// Chooses the first view of a scene, and of another scene that took its place after a reconnect.
void App::Impl::frameNewScene() {
  const protocol::Welcome* welcome = viewer.session().welcome();
  if (welcome == nullptr || width <= 0 || (framed && sameShape(*framed, *welcome))) return;
  const bool another = framed.has_value();
  framed = *welcome;
  box_min = welcome->origin + glm::dvec3(welcome->box_min);
  box_max = welcome->origin + glm::dvec3(welcome->box_max);
  flight.end();
  control.frameBox(box_min, box_max, glm::dvec3(welcome->up));
  if (another) {
    measure.clear();
    view.section.on = false;
    bookmarks = {};
  }
  cameraMoved();
  if (wanted_view) showView(*std::exchange(wanted_view, std::nullopt), true, false);
}

void App::Impl::moveTo(const Viewpoint& place, bool glide) {
  flight.end();
  if (glide && !reducedMotion())
    flight.begin(control.viewpoint(), place, now);
  else
    control.setViewpoint(place);
  cameraMoved();
}

/// Shows a link's view. `whole` includes what is no part of a viewpoint: the method and the statistics.
void App::Impl::showView(const ViewState& wanted, bool whole, bool glide) {
  control.setFov(wanted.fov_y);
  control.setOrthographic(wanted.orthographic);
  view.section = wanted.section;
  view.colors_by_resolution = wanted.colors_by_resolution;
  if (whole) {
    view.method = wanted.method;
    view.statistics = wanted.statistics;
  }
  moveTo({wanted.position, wanted.direction, wanted.pivot_distance}, glide);
}

// ---- motion by keys ----

bool App::Impl::flying() const {
  static constexpr std::array<Key, 14> kMoving{Key::kW,    Key::kA,     Key::kS,      Key::kD,       Key::kQ,
                                               Key::kE,    Key::kUp,    Key::kDown,   Key::kLeft,    Key::kRight,
                                               Key::kPlus, Key::kMinus, Key::kPageUp, Key::kPageDown};
  return std::any_of(kMoving.begin(), kMoving.end(), [this](Key key) { return held[static_cast<std::size_t>(key)]; });
}

void App::Impl::fly(double seconds) {
  const auto down = [this](Key key) { return held[static_cast<std::size_t>(key)] ? 1.0 : 0.0; };
  const double speed = seconds * (shift ? kShiftFactor : 1.0);
  const double right = down(Key::kRight) - down(Key::kLeft);
  const double forward = down(Key::kUp) - down(Key::kDown);

  // The arrows fly, or turn when ctrl is down.
  glm::dvec3 direction(down(Key::kD) - down(Key::kA), down(Key::kE) - down(Key::kQ), down(Key::kW) - down(Key::kS));
  if (turning) {
    const double pixels = kTurnSpeed * speed * settings.orbit_speed * height;
    if (right != 0.0 || forward != 0.0) control.orbit(-pixels * right, pixels * forward);
  } else {
    direction += glm::dvec3(right, 0.0, forward);
  }
  if (direction != glm::dvec3(0.0)) control.fly(kFlySpeed * settings.fly_speed * speed * direction);

  const double steps = kZoomKeySpeed * speed * (down(Key::kPlus) - down(Key::kMinus));
  if (steps != 0.0) control.zoom(steps, 0.5 * width, 0.5 * height, std::nullopt);

  const double along = down(Key::kPageUp) - down(Key::kPageDown);
  if (along != 0.0 && view.section.on)
    moveSection(along * speed / kSectionSeconds * (box_max - box_min)[view.section.axis]);
  cameraMoved();
}

// ---- time ----

void App::Impl::reportRest() {
  if (!ready() || flight.active() || flying() || gestures.anyDown() || now - last_motion < kRestSeconds) return;
  std::string link = formatPermalink(view);
  if (link == last_link) return;
  last_link = link;
  requests.push_back({.kind = RequestKind::kLinkChanged, .text = std::move(link)});
}

void App::Impl::updateMeters() {
  const SessionStats stats = viewer.stats().session;
  byte_rate.add(now, static_cast<double>(stats.bytes_received - seen_bytes));
  seen_bytes = stats.bytes_received;
  round_trip.update(now, stats.messages_received, stats.views_sent);
}

/// Advances the clock and everything that depends on it.
void App::Impl::advanceTo(double time) {
  if (!std::isfinite(time)) return;
  const double step = started ? std::clamp(time - now, 0.0, kMaxStep) : 0.0;
  started = true;
  now = std::max(now, time);
  frameNewScene();
  if (hidden) return;
  if (ready() && flight.active()) {
    control.setViewpoint(flight.at(control, now));
    cameraMoved();
  }
  if (ready() && flying() && step > 0.0) {
    flight.end();
    fly(step);
  }
  updateMeters();
  expireToasts();
  updateProgress();
  readPinAnswers();
  reportRest();
  if (overlay_dirty) refreshOverlay();
}

}  // namespace client
