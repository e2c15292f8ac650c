#include "client/app.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <utility>

#include "client/flight.h"
#include "client/gesture.h"
#include "client/meters.h"
#include "client/orbit_control.h"
#include "client/permalink.h"
#include "client/picture_query.h"

namespace client {
namespace {

/// Longest step of motion that one turn of the loop makes, so that a pause is no leap.
constexpr double kLongestStep = 0.1;  // seconds
/// Pivot distances per second, and how much faster with shift.
constexpr double kFlySpeed = 0.6;
constexpr double kShiftFactor = 4.0;
/// Turning by keys, in view heights (half a turn each) per second; zooming by keys, in wheel steps per second.
constexpr double kTurnSpeed = 0.4;
constexpr double kZoomKeySpeed = 5.0;
/// The section plane crosses the model in this many seconds while a key is held.
constexpr double kSectionSeconds = 6.0;
/// How near a press must be to a pin or handle, screen units: mice, and fingers and pens.
constexpr double kMouseReach = 12.0;
constexpr double kFingerReach = 24.0;
/// Wheel steps within this time at one place go to the same surface point, which is looked for only once.
constexpr double kWheelSeconds = 0.4;
/// Pinching to this ratio is one wheel step.
constexpr double kRatioPerStep = 1.25;
/// The view rests when nothing moved for this long.
constexpr double kRestSeconds = 0.4;
/// What takes less than this is not worth a progress bar.
constexpr double kProgressSeconds = 0.5;
constexpr double kToastSeconds = 3.5;
constexpr double kErrorSeconds = 8.0;
constexpr std::size_t kMaxToasts = 3;
/// Part of the progress bar that the shape takes; the images take the rest.
constexpr double kShapeShare = 0.6;

/// What of the settings the viewer is made with.
ViewerOptions viewerOptions(const AppOptions& options) {
  ViewerOptions viewer = options.viewer;
  if (!options.settings_rule) return viewer;
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

bool sameShape(const protocol::Welcome& a, const protocol::Welcome& b) {
  return a.scene_name == b.scene_name && a.origin == b.origin && a.box_min == b.box_min && a.box_max == b.box_max;
}

bool isOdd(double value) {
  return !std::isfinite(value);
}

}  // namespace

struct App::State {
  State(const AppOptions& wanted, std::unique_ptr<ImageDecoder> decoder)
      : options(wanted), settings(wanted.settings), viewer(viewerOptions(wanted), std::move(decoder)) {
    view.method = viewer.options().method;
    control.setFov(glm::radians(settings.fov_degrees));
  }

  AppOptions options;
  Settings settings;
  Viewer viewer;
  OrbitControl control;
  GestureReader gestures;
  Flight flight;
  ViewState view;  // camera fields as of the last change

  // The scene.
  std::optional<protocol::Welcome> framed;  // the one that the first view was chosen for
  std::optional<ViewState> wanted_view;     // a link that came before the scene
  glm::dvec3 box_min{0.0}, box_max{0.0};    // world

  // The surface drawn into.
  int width = 0, height = 0;
  double pixel_ratio = 1.0;
  bool hidden = false;
  bool system_reduces_motion = false;

  // Keys and pointers.
  std::array<bool, 256> held{};
  bool shift = false, turning = false;  // turning: ctrl was down when an arrow was pressed
  int handle_pointer = -1;              // the pointer that drags the section's handle
  glm::dvec2 handle_at{0.0};
  struct WheelTarget {
    double at = -1e9, x = 0.0, y = 0.0;
    std::optional<glm::dvec3> surface;
  } wheel_target;

  // Time.
  double now = 0.0, last_motion = 0.0;
  bool started = false;  // `now` has been told
  double draw_seconds = 0.0;
  RateMeter frame_rate, byte_rate;
  RoundTripMeter round_trip;
  std::uint64_t seen_bytes = 0;
  double images_used = 0.0, images_came = 0.0;  // for the hit rate
  std::uint64_t seen_images = 0;

  // What the last picture showed.
  bool dirty = true;
  bool moved_since_frame = true;
  std::uint64_t drawn_messages = 0;

  // Words over it.
  std::uint64_t overlay_version = 1;
  bool overlay_dirty = true;
  Status last_status;
  Progress progress;
  double incomplete_since = -1.0;
  float first_error = 0.0F;
  std::vector<Toast> toasts;
  std::vector<double> toast_ends;
  std::uint32_t next_toast = 1;
  bool help = false;
  std::vector<Label> labels;
  std::vector<LabelLine> lines;

  // Modes.
  Mode mode = Mode::kLook;
  MeasureTool measure;
  std::uint32_t next_pick = 1;
  std::vector<Annotation> annotations;
  std::vector<bool> pins_visible;
  bool pins_changed = false;  // since the viewer was told
  std::optional<std::size_t> open_annotation;

  std::array<std::string, kBookmarks> bookmarks;
  std::string last_link;
  std::vector<Request> requests;

  // Looking.
  bool ready() const { return framed.has_value(); }
  bool drawable() const { return width > 0 && height > 0 && !hidden; }
  bool reducedMotion() const {
    const auto choice = static_cast<ReducedMotion>(static_cast<int>(settings.reduced_motion));
    return choice == ReducedMotion::kOn || (choice == ReducedMotion::kSystem && system_reduces_motion);
  }
  base::ViewCamera drawnCamera() const;
  void handToViewer();
  std::optional<glm::dvec3> surfaceAt(double x, double y);
  double reach(PointerKind kind) const {
    return pixel_ratio * (kind == PointerKind::kMouse ? kMouseReach : kFingerReach);
  }

  // Changing.
  void touched();
  void cameraMoved();
  void say(std::string text, bool error);
  void frameNewScene();
  void fly(double seconds);
  bool flying() const;
  void goTo(const Place& place, bool glide);
  void showView(const ViewState& wanted, bool whole, bool glide);
  void keepUp(double time);

  // Gestures.
  void act(const Gesture& gesture);
  void click(const Gesture& gesture);
  void setPivotAt(double x, double y);
  std::optional<std::size_t> pinAt(double x, double y, PointerKind kind) const;
  void zoom(double steps, double x, double y);

  // Modes.
  void cycleMeasure();
  void setMode(Mode wanted);
  void measureAt(double x, double y);
  void cycleSection();
  void turnOnSection(int axis);
  void moveSection(double distance);
  int axisInOrder(int place) const;
  bool hiddenBySection(const glm::dvec3& world) const;
  Ray pickRay(double x, double y) const;
  glm::dvec3 handlePlace() const;
  bool grabHandle(const PointerEvent& event);
  void dragHandle(const PointerEvent& event);
  void stepAnnotation(int by);
  void openCard(std::optional<std::size_t> index);
  bool leave();
  void useBookmark(int slot, bool store);
  bool press(Key key, Modifiers modifiers);

  // Words.
  void refreshOverlay();
  void addPins();
  void addMeasurements();
  void addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate);
  Label labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const;
  void lookAtPins();
  bool pinHidden(std::size_t index) const;
  void updateProgress();
  void expireToasts();
  void noticeRest();
  void meter();
  Status status() const;
};

// ---- the camera and the viewer ----

/// The one place where the camera that is drawn is put together.
base::ViewCamera App::State::drawnCamera() const {
  base::ViewCamera camera = control.camera();
  camera.ortho_height = control.orthoHeight();
  return camera;
}

/// The one place where the viewer is told how to draw.
void App::State::handToViewer() {
  viewer.setMethod(view.method);
  viewer.setResolutionColors(view.colors_by_resolution);
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

std::optional<glm::dvec3> App::State::surfaceAt(double x, double y) {
  if (!ready()) return std::nullopt;
  return options.surface ? options.surface(drawnCamera(), x, y) : viewer.surfaceAt(drawnCamera(), x, y);
}

/// Something that is drawn over the picture has changed.
void App::State::touched() {
  overlay_dirty = true;
  ++overlay_version;
}

void App::State::cameraMoved() {
  const Place place = control.place();
  view.position = place.position;
  view.direction = place.direction;
  view.pivot_distance = place.distance;
  view.fov_y = control.camera().fov_y;
  view.orthographic = control.orthographic();
  dirty = true;
  moved_since_frame = true;
  last_motion = now;
  touched();
}

void App::State::say(std::string text, bool error) {
  if (!toasts.empty() && toasts.back().text == text) {
    toasts.pop_back();
    toast_ends.pop_back();
  }
  toasts.push_back({next_toast++, std::move(text), error});
  toast_ends.push_back(now + (error ? kErrorSeconds : kToastSeconds));
  if (toasts.size() > kMaxToasts) {
    toasts.erase(toasts.begin());
    toast_ends.erase(toast_ends.begin());
  }
  touched();
}

void App::State::expireToasts() {
  for (std::size_t i = toasts.size(); i-- > 0;) {
    if (toast_ends[i] > now) continue;
    toasts.erase(toasts.begin() + static_cast<std::ptrdiff_t>(i));
    toast_ends.erase(toast_ends.begin() + static_cast<std::ptrdiff_t>(i));
    touched();
  }
}

/// The first view of a scene, and of another one that took its place after a reconnect.
void App::State::frameNewScene() {
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

void App::State::goTo(const Place& place, bool glide) {
  flight.end();
  if (glide && !reducedMotion())
    flight.begin(control.place(), place, now);
  else
    control.setPlace(place);
  cameraMoved();
}

/// `whole`: with what is no part of a viewpoint, the method and the overlay.
void App::State::showView(const ViewState& wanted, bool whole, bool glide) {
  control.setFov(wanted.fov_y);
  control.setOrthographic(wanted.orthographic);
  view.section = wanted.section;
  view.colors_by_resolution = wanted.colors_by_resolution;
  if (whole) {
    view.method = wanted.method;
    view.statistics = wanted.statistics;
  }
  goTo({wanted.position, wanted.direction, wanted.pivot_distance}, glide);
}

// ---- motion by keys ----

bool App::State::flying() const {
  static constexpr std::array<Key, 14> kMoving{Key::kW,    Key::kA,     Key::kS,      Key::kD,       Key::kQ,
                                               Key::kE,    Key::kUp,    Key::kDown,   Key::kLeft,    Key::kRight,
                                               Key::kPlus, Key::kMinus, Key::kPageUp, Key::kPageDown};
  return std::any_of(kMoving.begin(), kMoving.end(), [this](Key key) { return held[static_cast<std::size_t>(key)]; });
}

void App::State::fly(double seconds) {
  const auto down = [this](Key key) { return held[static_cast<std::size_t>(key)] ? 1.0 : 0.0; };
  const double speed = seconds * (shift ? kShiftFactor : 1.0);
  const double right = down(Key::kRight) - down(Key::kLeft);
  const double forward = down(Key::kUp) - down(Key::kDown);

  // Arrows fly, or turn with ctrl.
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

// ---- gestures ----

void App::State::act(const Gesture& g) {
  if (!ready()) return;
  flight.end();
  switch (g.kind) {
    case GestureKind::kOrbit:
      control.orbit(g.dx * settings.orbit_speed, g.dy * settings.orbit_speed);
      break;
    case GestureKind::kGrab:
      control.grab(g.x, g.y, surfaceAt(g.x, g.y));
      return;
    case GestureKind::kPan:
      control.dragTo(g.x, g.y);
      break;
    case GestureKind::kPinch:
      control.zoom(std::log(g.factor) / std::log(kRatioPerStep), g.x, g.y, control.grabbed());
      break;
    case GestureKind::kClick:
    case GestureKind::kDoubleClick:
      click(g);
      return;
  }
  cameraMoved();
}

void App::State::click(const Gesture& g) {
  const bool twice = g.kind == GestureKind::kDoubleClick;
  if (mode != Mode::kLook) {
    if (twice && mode == Mode::kDistance) {
      measure.finish();
      touched();
    } else {
      measureAt(g.x, g.y);
    }
    return;
  }
  if (const auto pin = pinAt(g.x, g.y, g.pointer)) {
    if (!twice) openCard(pin);
    return;
  }
  if (twice) setPivotAt(g.x, g.y);
}

void App::State::setPivotAt(double x, double y) {
  if (const auto surface = surfaceAt(x, y)) goTo(control.centredOn(*surface), true);
}

/// The nearest one that can be seen.
std::optional<std::size_t> App::State::pinAt(double x, double y, PointerKind kind) const {
  std::optional<std::size_t> found;
  double nearest = reach(kind);
  for (const Label& label : labels) {
    if (label.kind != LabelKind::kPin || !label.visible) continue;
    const double distance = std::hypot(label.x - x, label.y - y);
    if (distance > nearest) continue;
    nearest = distance;
    found = label.index;
  }
  return found;
}

void App::State::zoom(double steps, double x, double y) {
  if (!ready() || steps == 0.0) return;
  flight.end();
  WheelTarget& target = wheel_target;
  const bool same = now - target.at < kWheelSeconds && std::hypot(target.x - x, target.y - y) <= 2.0 * pixel_ratio;
  if (!same) target.surface = surfaceAt(x, y);
  target.at = now;
  target.x = x;
  target.y = y;
  control.zoom(steps * settings.zoom_speed, x, y, target.surface);
  cameraMoved();
}

// ---- measuring ----

void App::State::cycleMeasure() {
  setMode(mode == Mode::kLook ? Mode::kDistance : mode == Mode::kDistance ? Mode::kAngle : Mode::kLook);
}

void App::State::setMode(Mode wanted) {
  mode = wanted;
  if (mode == Mode::kLook)
    measure.clear();
  else
    measure.start(mode == Mode::kDistance ? MeasureKind::kDistance : MeasureKind::kAngle);
  dirty = true;
  touched();
}

/// From where the section cuts off nothing any more.
Ray App::State::pickRay(double x, double y) const {
  Ray ray = control.rayAt(x, y);
  if (!hiddenBySection(ray.origin)) return ray;
  const double towards = ray.direction[view.section.axis];
  const double gap = view.section.offset - ray.origin[view.section.axis];
  if (gap * towards > 0.0) ray.origin += gap / towards * ray.direction;
  return ray;
}

void App::State::measureAt(double x, double y) {
  const auto surface = surfaceAt(x, y);
  if (!surface) return say("There is no surface at this place", false);

  // What is on the screen, until the answer is here.
  MeasuredPoint point;
  point.position = *surface;
  point.accuracy = control.pixelSizeAt(*surface) * (0.5 + static_cast<double>(viewer.stats().error_px));
  point.pick_id = next_pick;
  if (!measure.add(point)) {
    if (measure.full()) say("There are too many points; Escape clears them", false);
    return;
  }
  const Ray ray = pickRay(x, y);
  Request request;
  request.kind = RequestKind::kPick;
  request.id = next_pick++;
  request.origin = ray.origin;
  request.direction = ray.direction;
  requests.push_back(std::move(request));
  dirty = true;
  touched();
}

// ---- the section plane ----

bool App::State::hiddenBySection(const glm::dvec3& world) const {
  const Section& s = view.section;
  if (!s.on) return false;
  // A hair on the hidden side is the plane itself.
  const double beyond = (world[s.axis] - s.offset) * (s.keep_below ? 1.0 : -1.0);
  return beyond > 1e-9 * control.sceneSize();
}

/// The scene's up axis first, then the other two.
int App::State::axisInOrder(int place) const {
  const glm::vec3 up = glm::abs(framed->up);
  const int first = up.x > up.y && up.x > up.z ? 0 : up.y > up.z ? 1 : 2;
  return (first + place) % 3;
}

void App::State::cycleSection() {
  int place = 0;
  if (view.section.on)
    while (axisInOrder(place++) != view.section.axis) {
    }
  if (place == 3) {
    view.section.on = false;
    cameraMoved();
    return;
  }
  turnOnSection(axisInOrder(place));
}

/// Through the middle of the model, with the near half cut off.
void App::State::turnOnSection(int axis) {
  view.section = {true, axis, control.camera().direction[axis] < 0.0, 0.5 * (box_min[axis] + box_max[axis])};
  cameraMoved();
}

void App::State::moveSection(double distance) {
  Section& s = view.section;
  s.offset = std::clamp(s.offset + distance, box_min[s.axis], box_max[s.axis]);
}

glm::dvec3 App::State::handlePlace() const {
  glm::dvec3 place = 0.5 * (box_min + box_max);
  place[view.section.axis] = view.section.offset;
  return place;
}

bool App::State::grabHandle(const PointerEvent& event) {
  if (!ready() || !view.section.on || handle_pointer >= 0 || event.button != PointerButton::kLeft) return false;
  const ScreenPoint at = control.project(handlePlace());
  if (at.depth <= 0.0 && !control.orthographic()) return false;
  if (std::hypot(at.x - event.x, at.y - event.y) > reach(event.kind)) return false;
  handle_pointer = event.id;
  handle_at = {event.x, event.y};
  return true;
}

/// The plane follows the pointer as far as the axis can be seen; seen along the axis, up and down move it.
void App::State::dragHandle(const PointerEvent& event) {
  const glm::dvec2 drag = glm::dvec2(event.x, event.y) - handle_at;
  handle_at = {event.x, event.y};
  const glm::dvec3 place = handlePlace();
  const double pixel = control.pixelSizeAt(place);
  if (pixel <= 0.0) return;
  glm::dvec3 further = place;
  further[view.section.axis] += pixel;
  const ScreenPoint a = control.project(place);
  const ScreenPoint b = control.project(further);
  const glm::dvec2 along(b.x - a.x, b.y - a.y);  // pixels that the plane moves on the screen for one pixel's size
  const double length = glm::length(along);
  moveSection(length > 0.1 ? pixel * glm::dot(drag, along) / (length * length) : -pixel * drag.y);
  cameraMoved();
}

// ---- notes ----

void App::State::openCard(std::optional<std::size_t> index) {
  if (index && *index >= annotations.size()) index.reset();
  open_annotation = index;
  touched();
  if (!index || !annotations[*index].camera || !ready()) return;
  const base::ViewCamera& camera = *annotations[*index].camera;
  const double depth = glm::dot(annotations[*index].position - camera.position, camera.direction);
  goTo({camera.position, camera.direction, depth > 0.0 ? depth : control.place().distance}, true);
}

void App::State::stepAnnotation(int by) {
  if (annotations.empty()) return say("This scene has no notes", false);
  const auto count = static_cast<std::ptrdiff_t>(annotations.size());
  const std::ptrdiff_t from = open_annotation ? static_cast<std::ptrdiff_t>(*open_annotation)
                                              : (by > 0 ? std::ptrdiff_t{-1} : std::ptrdiff_t{0});
  openCard(static_cast<std::size_t>((from + by + count) % count));
}

// ---- keys ----

/// Leaves the innermost thing that is open. False when there is none.
bool App::State::leave() {
  if (help) {
    help = false;
  } else if (open_annotation) {
    open_annotation.reset();
  } else if (mode != Mode::kLook) {
    setMode(Mode::kLook);
  } else if (view.section.on) {
    view.section.on = false;
    cameraMoved();
  } else {
    return false;
  }
  dirty = true;
  touched();
  return true;
}

void App::State::useBookmark(int slot, bool store) {
  const std::string number = std::to_string(slot);
  std::string& link = bookmarks[static_cast<std::size_t>(slot)];
  if (!ready()) return;
  if (slot == 0) {
    if (store) return say("0 is always the first view; 1 to 9 can be set", false);
    return goTo(control.firstPlace(), true);
  }
  if (store) {
    link = formatPermalink(view);
    Request request;
    request.kind = RequestKind::kKeepBookmarks;
    requests.push_back(std::move(request));
    return say("Bookmark " + number + " set", false);
  }
  const auto wanted = parsePermalink(link);
  if (!wanted) return say("Bookmark " + number + " is empty; shift + " + number + " sets it", false);
  showView(*wanted, false, true);
}

bool App::State::press(Key key, Modifiers modifiers) {
  if (key >= Key::k0 && key <= Key::k9) {
    useBookmark(static_cast<int>(key) - static_cast<int>(Key::k0), modifiers.shift || modifiers.ctrl);
    return true;
  }
  // Everything else with ctrl is the system's: copy, print, reload.
  if (modifiers.ctrl || modifiers.alt) return false;
  if (key == Key::kEscape) return leave();
  if (key == Key::kH) {
    help = !help;
    touched();
    return true;
  }
  if (!ready()) return false;
  switch (key) {
    case Key::kF:
      goTo(control.framingPlace(), true);
      break;
    case Key::kR:
    case Key::kHome:
      goTo(control.firstPlace(), true);
      break;
    case Key::kI:
      view.statistics = !view.statistics;
      last_motion = now;
      touched();
      break;
    case Key::kC:
      view.colors_by_resolution = !view.colors_by_resolution;
      cameraMoved();
      break;
    case Key::kO:
      control.setOrthographic(!control.orthographic());
      cameraMoved();
      break;
    case Key::kM:
      cycleMeasure();
      break;
    case Key::kX:
      if (modifiers.shift && view.section.on) {
        view.section.keep_below = !view.section.keep_below;
        cameraMoved();
      } else {
        cycleSection();
      }
      break;
    case Key::kN:
      stepAnnotation(modifiers.shift ? -1 : 1);
      break;
    case Key::kEnter:
      if (mode == Mode::kLook)
        setPivotAt(0.5 * width, 0.5 * height);
      else
        measureAt(0.5 * width, 0.5 * height);
      break;
    case Key::kBackspace:
      if (mode == Mode::kLook) return false;
      measure.removeLast();
      dirty = true;
      touched();
      break;
    case Key::kG: {
      Request request;
      request.kind = RequestKind::kShowSettings;
      requests.push_back(std::move(request));
      break;
    }
    case Key::kV: {
      Request request;
      request.kind = RequestKind::kCopyLink;
      request.text = formatPermalink(view);
      requests.push_back(std::move(request));
      break;
    }
    case Key::kP: {
      Request request;
      request.kind = RequestKind::kSavePicture;
      request.camera = drawnCamera();
      request.text =
          pictureQuery(request.camera, view, static_cast<double>(viewer.options().session.patch_tolerance_px));
      requests.push_back(std::move(request));
      break;
    }
    default:
      return false;
  }
  return true;
}

// ---- words over the picture ----

Label App::State::labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const {
  const ScreenPoint at = control.project(world);
  Label label;
  label.kind = kind;
  label.index = static_cast<std::uint32_t>(index);
  label.x = at.x;
  label.y = at.y;
  label.visible =
      (at.depth > 0.0 || control.orthographic()) && at.x >= 0.0 && at.x <= width && at.y >= 0.0 && at.y <= height;
  return label;
}

void App::State::addPins() {
  for (std::size_t i = 0; i < annotations.size(); ++i) {
    Label label = labelAt(LabelKind::kPin, i, annotations[i].position);
    label.text = annotations[i].title;
    label.open = open_annotation == i;
    const glm::dvec3 towards_eye =
        control.orthographic() ? -control.camera().direction : control.camera().position - annotations[i].position;
    const bool turned_away = glm::dot(annotations[i].normal, towards_eye) < 0.0;
    if (turned_away || pinHidden(i) || hiddenBySection(annotations[i].position)) label.visible = false;
    labels.push_back(std::move(label));
  }
}

/// Cut where it would pass the eye.
void App::State::addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate) {
  const glm::dvec3& eye = control.camera().position;
  const glm::dvec3& axis = control.camera().direction;
  const double nearest = 1e-6 * control.sceneSize();
  double depth_a = glm::dot(a - eye, axis);
  double depth_b = glm::dot(b - eye, axis);
  glm::dvec3 from = a;
  glm::dvec3 to = b;
  if (!control.orthographic()) {
    if (depth_a < nearest && depth_b < nearest) return;
    if (depth_a < nearest) from = b + (a - b) * ((depth_b - nearest) / (depth_b - depth_a));
    if (depth_b < nearest) to = a + (b - a) * ((depth_a - nearest) / (depth_a - depth_b));
  }
  const ScreenPoint p = control.project(from);
  const ScreenPoint q = control.project(to);
  lines.push_back({p.x, p.y, q.x, q.y, approximate});
}

void App::State::addMeasurements() {
  std::size_t point_index = 0;
  std::size_t value_index = 0;
  for (const Measurement& one : measure.all()) {
    for (std::size_t i = 0; i < one.points.size(); ++i) {
      Label label = labelAt(LabelKind::kPoint, point_index++, one.points[i].position);
      label.approximate = one.points[i].approximate;
      labels.push_back(std::move(label));
      if (i > 0)
        addLine(one.points[i - 1].position, one.points[i].position,
                one.points[i - 1].approximate || one.points[i].approximate);
    }
    for (const MeasuredValue& value : measuredValues(one, framed->units)) {
      Label label = labelAt(LabelKind::kValue, value_index++, value.at);
      label.approximate = value.approximate;
      label.text = value.text;
      labels.push_back(std::move(label));
    }
  }
}

void App::State::refreshOverlay() {
  overlay_dirty = false;
  labels.clear();
  lines.clear();
  if (!ready() || width <= 0) return;
  addPins();
  addMeasurements();
  if (view.section.on) labels.push_back(labelAt(LabelKind::kSectionHandle, 0, handlePlace()));
}

/// The viewer's answers come a frame or two late, and then stay; all pins are seen at one time.
void App::State::lookAtPins() {
  if (annotations.empty() || options.surface) return;
  const std::vector<bool>& visible = viewer.pinsVisible();
  if (visible == pins_visible) return;
  pins_visible = visible;
  touched();
}

/// Without GL nothing is known to lie in front of a pin.
bool App::State::pinHidden(std::size_t index) const {
  if (options.surface) return false;
  return index >= pins_visible.size() || !pins_visible[index];
}

Status App::State::status() const {
  const Session& session = viewer.session();
  const std::string& problem = session.problem();
  switch (session.state()) {
    case SessionState::kRefused:
      return {Status::Kind::kRefused, problem, "When that is mended, open the scene again."};
    case SessionState::kDisconnected:
      if (problem.empty()) return {Status::Kind::kConnecting, "", ""};
      return {Status::Kind::kLost, problem,
              ready() ? "Trying again; what is here can be looked at meanwhile." : "Trying again."};
    case SessionState::kGreeting:
      return {Status::Kind::kConnecting, "", ""};
    case SessionState::kReady:
      break;
  }
  return {viewer.stats().complete ? Status::Kind::kReady : Status::Kind::kLoading, "", ""};
}

void App::State::updateProgress() {
  const Status present = status();
  if (present.kind != last_status.kind || present.text != last_status.text) touched();
  last_status = present;
  const bool loading = present.kind == Status::Kind::kLoading || present.kind == Status::Kind::kConnecting;
  const Progress before = progress;
  if (!loading) {
    progress = {};
    incomplete_since = -1.0;
  } else {
    const ViewerStats stats = viewer.stats();
    if (incomplete_since < 0.0) {
      incomplete_since = now;
      first_error = 0.0F;
    }
    first_error = std::max(first_error, stats.error_px);

    // Shape on a logarithmic scale of its error, then images.
    double share = 0.0;
    if (stats.lumigraph.triangles > 0) {
      const double goal = std::max(static_cast<double>(viewer.options().session.patch_tolerance_px), 0.1);
      const double whole = std::log(std::max(static_cast<double>(first_error), goal) / goal);
      const double open = std::log(std::max(static_cast<double>(stats.error_px), goal) / goal);
      share = kShapeShare * (whole > 0.0 ? 1.0 - open / whole : 1.0);
      const double used = stats.lumigraph.samples_used;
      if (open <= 0.0 && used > 0.0) share += (0.95 - kShapeShare) * used / (used + stats.images_requested);
    }
    progress.active = now - incomplete_since >= kProgressSeconds;
    progress.share = std::max(progress.share, share);
  }
  if (before.active != progress.active || (progress.active && before.share != progress.share)) ++overlay_version;
}

void App::State::noticeRest() {
  if (!ready() || flight.active() || flying() || gestures.anyDown() || now - last_motion < kRestSeconds) return;
  std::string link = formatPermalink(view);
  if (link == last_link) return;
  last_link = link;
  Request request;
  request.kind = RequestKind::kLinkChanged;
  request.text = std::move(link);
  requests.push_back(std::move(request));
}

void App::State::meter() {
  const SessionStats& stats = viewer.session().stats();
  byte_rate.add(now, static_cast<double>(stats.bytes_received - seen_bytes));
  seen_bytes = stats.bytes_received;
  round_trip.update(now, stats.messages_received, stats.views_sent);
}

/// Time goes on.
void App::State::keepUp(double time) {
  if (!std::isfinite(time)) return;
  const double step = started ? std::clamp(time - now, 0.0, kLongestStep) : 0.0;
  started = true;
  now = std::max(now, time);
  frameNewScene();
  if (hidden) return;
  if (ready() && flight.active()) {
    control.setPlace(flight.at(control, now));
    cameraMoved();
  }
  if (ready() && flying() && step > 0.0) {
    flight.end();
    fly(step);
  }
  meter();
  expireToasts();
  updateProgress();
  lookAtPins();
  noticeRest();
  if (overlay_dirty) refreshOverlay();
}

// ---- the public face: events ----

App::App(const AppOptions& options, std::unique_ptr<ImageDecoder> decoder)
    : state_(std::make_unique<State>(options, std::move(decoder))) {}
App::~App() = default;

Session& App::session() {
  return state_->viewer.session();
}
Viewer& App::viewer() {
  return state_->viewer;
}

void App::resize(int width_px, int height_px, double pixel_ratio) {
  State& s = *state_;
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
  State& s = *state_;
  if (isOdd(event.x) || isOdd(event.y) || isOdd(event.now)) return;
  if (!s.gestures.anyDown() && s.grabHandle(event)) return;
  s.gestures.down(event);
}

void App::pointerMove(const PointerEvent& event) {
  State& s = *state_;
  if (isOdd(event.x) || isOdd(event.y) || isOdd(event.now)) return;
  if (event.id == s.handle_pointer) return s.dragHandle(event);
  for (const Gesture& gesture : s.gestures.move(event)) s.act(gesture);
}

void App::pointerUp(const PointerEvent& event) {
  State& s = *state_;
  if (isOdd(event.x) || isOdd(event.y) || isOdd(event.now)) return pointerCancel(event.id);
  if (event.id == s.handle_pointer) {
    s.handle_pointer = -1;
    return;
  }
  for (const Gesture& gesture : s.gestures.up(event)) s.act(gesture);
}

void App::pointerCancel(int id) {
  if (id == state_->handle_pointer) state_->handle_pointer = -1;
  state_->gestures.cancel(id);
}

void App::wheel(double steps, double x, double y, double now) {
  if (isOdd(steps) || isOdd(x) || isOdd(y) || isOdd(now)) return;
  state_->now = std::max(state_->now, now);
  state_->zoom(std::clamp(steps, -20.0, 20.0), x, y);
}

bool App::key(Key key, bool down, Modifiers modifiers, double now) {
  State& s = *state_;
  if (!isOdd(now)) s.now = std::max(s.now, now);
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
  if (held) return true;  // the keyboard repeats itself
  const bool taken = s.press(key, modifiers);
  held = taken;
  return taken;
}

void App::blur() {
  State& s = *state_;
  s.held.fill(false);
  s.shift = false;
  s.gestures.cancelAll();
  s.handle_pointer = -1;
}

void App::setHidden(bool hidden) {
  State& s = *state_;
  if (hidden) blur();
  if (!hidden && s.hidden) {
    s.dirty = true;
    s.started = false;  // the time between is no motion
  }
  s.hidden = hidden;
}

void App::setReducedMotion(bool system_wants) {
  state_->system_reduces_motion = system_wants;
}

void App::contextLost() {
  state_->viewer.contextLost();
}

base::Result<void> App::contextRestored() {
  state_->dirty = true;
  state_->pins_changed = true;
  return state_->viewer.contextRestored();
}

// ---- the public face: the loop ----

void App::advance(double now) {
  state_->keepUp(now);
}

bool App::wantsFrame() const {
  const State& s = *state_;
  if (!s.drawable()) return false;
  if (s.dirty || s.flight.active() || s.flying()) return true;
  const ViewerStats stats = s.viewer.stats();
  return stats.busy || stats.session.messages_received != s.drawn_messages;
}

base::Result<void> App::frame(double now) {
  State& s = *state_;
  s.keepUp(now);
  if (!s.drawable()) return {};
  const double begin = s.options.clock ? s.options.clock() : 0.0;
  s.drawn_messages = s.viewer.session().stats().messages_received;
  if (!s.ready()) {
    // The first view is chosen when the scene is known; a server that heard of any other would send what it shows.
    s.viewer.drawBackground();
    s.dirty = false;
    return {};
  }
  s.handToViewer();
  LUMIGRID_TRY(s.viewer.draw(s.drawnCamera(), s.now));
  if (s.options.clock) s.draw_seconds += 0.2 * (s.options.clock() - begin - s.draw_seconds);
  s.frame_rate.add(s.now, 1.0);

  // Of the images that a moving view uses, how many came for it.
  const ViewerStats stats = s.viewer.stats();
  const std::uint64_t images = stats.session.faces_received + stats.session.frames_received;
  s.images_came += static_cast<double>(images - s.seen_images);
  s.seen_images = images;
  if (s.moved_since_frame) s.images_used += stats.lumigraph.samples_used;
  s.moved_since_frame = false;
  s.dirty = false;
  s.lookAtPins();
  s.refreshOverlay();
  ++s.overlay_version;
  return {};
}

// ---- the public face: requests ----

std::vector<Request> App::takeRequests() {
  return std::exchange(state_->requests, {});
}

void App::answerPick(std::uint32_t id, const PickAnswer& answer) {
  State& s = *state_;
  PickAnswer taken = answer;
  if (taken.kind == PickAnswer::Kind::kHit &&
      (isOdd(glm::dot(taken.point, taken.point)) || isOdd(taken.accuracy) || s.hiddenBySection(taken.point)))
    taken.kind = PickAnswer::Kind::kUnknown;
  if (!s.measure.answer(id, taken)) return;
  s.dirty = true;
  s.touched();
}

void App::say(std::string text, bool error) {
  state_->say(std::move(text), error);
}

// ---- the public face: state ----

const ViewState& App::view() const {
  return state_->view;
}
std::string App::permalink() const {
  return formatPermalink(state_->view);
}

void App::showStatistics(bool shown) {
  state_->view.statistics = shown;
  state_->touched();
}

void App::setBackground(const std::array<float, 4>& color) {
  state_->viewer.setBackground(color);
  state_->dirty = true;
}

base::Result<void> App::openPermalink(std::string_view text) {
  State& s = *state_;
  auto wanted = parsePermalink(text);
  if (!wanted) {
    s.say(wanted.error().message, true);
    return wanted.error();
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
  return state_->bookmarks[static_cast<std::size_t>(slot)];
}

base::Result<void> App::setBookmark(int slot, std::string_view permalink) {
  if (slot < 1 || slot >= kBookmarks)
    return base::Error{base::ErrorCode::kInvalidInput, "bookmarks are numbered from 1 to 9"};
  if (!permalink.empty()) {
    const auto parsed = parsePermalink(permalink);
    if (!parsed) return base::within("bookmark " + std::to_string(slot), parsed.error());
  }
  state_->bookmarks[static_cast<std::size_t>(slot)] = permalink;
  return {};
}

const Settings& App::settings() const {
  return state_->settings;
}

base::Result<void> App::changeSetting(std::string_view name, double value) {
  State& s = *state_;
  const Settings before = s.settings;
  LUMIGRID_TRY(setSetting(s.settings, name, value));
  if (s.settings == before) return {};
  if (s.settings.fov_degrees != before.fov_degrees) {
    s.control.setFov(glm::radians(s.settings.fov_degrees));
    s.cameraMoved();
  }
  Request request;
  request.kind = RequestKind::kKeepSettings;
  s.requests.push_back(std::move(request));
  s.touched();
  return {};
}

void App::setAnnotations(std::vector<Annotation> annotations) {
  State& s = *state_;
  if (annotations.size() > kMaxAnnotations) {
    annotations.resize(kMaxAnnotations);
    s.say("Only the first " + std::to_string(kMaxAnnotations) + " notes are shown", true);
  }
  s.annotations = std::move(annotations);
  s.open_annotation.reset();
  s.pins_visible.clear();
  s.pins_changed = true;
  s.dirty = true;
  s.touched();
}

const std::vector<Annotation>& App::annotations() const {
  return state_->annotations;
}

// ---- the public face: the overlay ----

std::uint64_t App::overlayVersion() const {
  return state_->overlay_version;
}
const std::vector<Label>& App::labels() const {
  return state_->labels;
}
const std::vector<LabelLine>& App::lines() const {
  return state_->lines;
}
const std::vector<Toast>& App::toasts() const {
  return state_->toasts;
}
Status App::status() const {
  return state_->status();
}
Progress App::progress() const {
  return state_->progress;
}
Mode App::mode() const {
  return state_->mode;
}

std::string App::modeHint() const {
  if (state_->mode == Mode::kDistance)
    return "Distance: click point after point, double click ends. Enter takes the middle. M: angles. Escape: done.";
  if (state_->mode == Mode::kAngle)
    return "Angle: click one arm's end, the corner, the other arm's end. Backspace takes one back. Escape: done.";
  return "";
}

bool App::helpShown() const {
  return state_->help;
}

void App::showHelp(bool shown) {
  if (state_->help != shown) state_->touched();
  state_->help = shown;
}

std::optional<std::size_t> App::openAnnotation() const {
  return state_->open_annotation;
}
void App::showAnnotation(std::optional<std::size_t> index) {
  state_->openCard(index);
}
const std::vector<Measurement>& App::measurements() const {
  return state_->measure.all();
}

const std::string& App::unit() const {
  static const std::string kUnknown;
  return state_->framed ? state_->framed->units : kUnknown;
}
std::string App::sceneName() const {
  return state_->framed ? state_->framed->scene_name : "";
}
base::ViewCamera App::camera() const {
  return state_->drawnCamera();
}

Statistics App::statistics() const {
  const State& s = *state_;
  const ViewerStats stats = s.viewer.stats();
  Statistics out;
  out.frames_per_second = s.frame_rate.perSecond(s.now);
  out.frame_milliseconds = 1e3 * s.draw_seconds;
  out.images_in_use = stats.lumigraph.samples_used;
  out.images_resident = stats.lumigraph.samples_resident;
  out.images_requested = stats.images_requested;
  out.patches = stats.lumigraph.patches;
  out.triangles = stats.lumigraph.triangles;
  out.memory_bytes = stats.memory.total();
  out.memory_budget = stats.memory_budget;
  out.gpu_bytes = stats.memory.gpu();
  out.received_bytes = stats.session.bytes_received;
  out.received_images = stats.session.bytes_faces;
  out.received_patches = stats.session.bytes_patches;
  out.received_frames = stats.session.bytes_frames;
  out.megabits_per_second = 8e-6 * s.byte_rate.perSecond(s.now);
  out.round_trip_milliseconds = 1e3 * s.round_trip.seconds();
  out.error_px = static_cast<double>(stats.error_px);
  const double asked = s.images_used + s.images_came;
  out.hit_rate = asked > 0.0 ? s.images_used / asked : 0.0;
  out.complete = stats.complete;
  out.broken = stats.broken;
  out.last_fault = stats.last_fault;
  out.accuracy = stats.accuracy;
  return out;
}

}  // namespace client
