#include "client/app/app_impl.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "client/app/permalink.h"
#include "client/app/picture_query.h"

namespace client {

// ---- gestures ----

void App::Impl::applyGesture(const Gesture& g) {
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
    case GestureKind::kPinch: {
      // A pinch by this ratio equals one wheel step: the inverse of the 0.8 by which a step scales the distance.
      constexpr double kRatioPerStep = 1.25;
      control.zoom(std::log(g.factor) / std::log(kRatioPerStep), g.x, g.y, control.grabbed());
      break;
    }
    case GestureKind::kClick:
    case GestureKind::kDoubleClick:
      handleClick(g);
      return;
  }
  cameraMoved();
}

void App::Impl::handleClick(const Gesture& g) {
  const bool twice = g.kind == GestureKind::kDoubleClick;
  if (mode != Mode::kLook) {
    if (twice && mode == Mode::kDistance) {
      measure.finish();
      overlayChanged();
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

void App::Impl::setPivotAt(double x, double y) {
  if (const auto surface = surfaceAt(x, y)) moveTo(control.viewpointCentredOn(*surface), true);
}

/// Radius around a pin or handle within which a press hits it: wider for fingers and pens than for mice.
double App::Impl::pickRadius(PointerKind kind) const {
  constexpr double kMouse = 12.0, kFinger = 24.0;  // screen units
  return pixel_ratio * (kind == PointerKind::kMouse ? kMouse : kFinger);
}

/// Returns the nearest visible pin within reach.
std::optional<std::size_t> App::Impl::pinAt(double x, double y, PointerKind kind) const {
  std::optional<std::size_t> found;
  double nearest = pickRadius(kind);
  for (const Label& label : labels) {
    if (label.kind != LabelKind::kPin || !label.visible) continue;
    const double distance = std::hypot(label.x - x, label.y - y);
    if (distance > nearest) continue;
    nearest = distance;
    found = label.index;
  }
  return found;
}

/// Zooms by steps of the wheel. Those that follow soon at one place go to the same surface point, which is looked up
/// only once.
void App::Impl::zoom(double steps, double x, double y) {
  constexpr double kWheelSeconds = 0.4;
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

void App::Impl::cycleMeasure() {
  setMode(mode == Mode::kLook ? Mode::kDistance : mode == Mode::kDistance ? Mode::kAngle : Mode::kLook);
}

void App::Impl::setMode(Mode wanted) {
  mode = wanted;
  if (mode == Mode::kLook)
    measure.clear();
  else
    measure.start(mode == Mode::kDistance ? MeasureKind::kDistance : MeasureKind::kAngle);
  dirty = true;
  overlayChanged();
}

/// Returns the ray through a pixel, beginning where the section no longer cuts it off.
Ray App::Impl::pickRay(double x, double y) const {
  Ray ray = control.rayAt(x, y);
  if (!hiddenBySection(ray.origin)) return ray;
  const double towards = ray.direction[view.section.axis];
  const double gap = view.section.offset - ray.origin[view.section.axis];
  if (gap * towards > 0.0) ray.origin += gap / towards * ray.direction;
  return ray;
}

void App::Impl::measureAt(double x, double y) {
  const auto surface = surfaceAt(x, y);
  if (!surface) return showToast("There is no surface at this place", false);

  // Use the point on the screen until the answer arrives.
  MeasuredPoint point;
  point.position = *surface;
  point.accuracy = control.pixelSizeAt(*surface) * (0.5 + static_cast<double>(viewer.stats().error_px));
  point.pick_id = next_pick;
  if (!measure.add(point)) {
    if (measure.full()) showToast("There are too many points; Escape clears them", false);
    return;
  }
  const Ray ray = pickRay(x, y);
  requests.push_back({.kind = RequestKind::kPick, .id = next_pick++, .origin = ray.origin, .direction = ray.direction});
  dirty = true;
  overlayChanged();
}

// ---- the section plane ----

bool App::Impl::hiddenBySection(const glm::dvec3& world) const {
  const Section& s = view.section;
  if (!s.on) return false;
  // A rounding error on the hidden side counts as on the plane.
  const double beyond = (world[s.axis] - s.offset) * (s.keep_below ? 1.0 : -1.0);
  return beyond > 1e-9 * control.sceneSize();
}

/// Returns the axes in the order in which X goes through them: the scene's up axis first, then the other two.
int App::Impl::sectionAxis(int place) const {
  const glm::vec3 up = glm::abs(framed->up);
  const int first = up.x > up.y && up.x > up.z ? 0 : up.y > up.z ? 1 : 2;
  return (first + place) % 3;
}

void App::Impl::cycleSection() {
  int place = 0;
  if (view.section.on)
    while (sectionAxis(place++) != view.section.axis) {
    }
  if (place == 3) {
    view.section.on = false;
    cameraMoved();
    return;
  }
  turnOnSection(sectionAxis(place));
}

/// Puts the plane through the middle of the model and cuts off the near half.
void App::Impl::turnOnSection(int axis) {
  view.section = {true, axis, control.camera().direction[axis] < 0.0, 0.5 * (box_min[axis] + box_max[axis])};
  cameraMoved();
}

void App::Impl::moveSection(double distance) {
  Section& s = view.section;
  s.offset = std::clamp(s.offset + distance, box_min[s.axis], box_max[s.axis]);
}

glm::dvec3 App::Impl::sectionHandle() const {
  glm::dvec3 place = 0.5 * (box_min + box_max);
  place[view.section.axis] = view.section.offset;
  return place;
}

bool App::Impl::grabHandle(const PointerEvent& event) {
  if (!ready() || !view.section.on || handle_pointer >= 0 || event.button != PointerButton::kLeft) return false;
  const ScreenPoint at = control.project(sectionHandle());
  if (at.depth <= 0.0 && !control.orthographic()) return false;
  if (std::hypot(at.x - event.x, at.y - event.y) > pickRadius(event.kind)) return false;
  handle_pointer = event.id;
  handle_at = {event.x, event.y};
  return true;
}

/// Moves the plane with the pointer along its axis as seen on the screen. When the axis points at the viewer, up and
/// down move it.
void App::Impl::dragHandle(const PointerEvent& event) {
  const glm::dvec2 drag = glm::dvec2(event.x, event.y) - handle_at;
  handle_at = {event.x, event.y};
  const glm::dvec3 place = sectionHandle();
  const double pixel = control.pixelSizeAt(place);
  if (pixel <= 0.0) return;
  glm::dvec3 further = place;
  further[view.section.axis] += pixel;
  const ScreenPoint a = control.project(place);
  const ScreenPoint b = control.project(further);
  const glm::dvec2 along(
      b.x - a.x, b.y - a.y);  // pixels by which the handle moves on the screen when the plane moves by one pixel's size
  const double length = glm::length(along);
  moveSection(length > 0.1 ? pixel * glm::dot(drag, along) / (length * length) : -pixel * drag.y);
  cameraMoved();
}

// ---- the magnifying glass ----

double App::Impl::lensRadius() const {
  constexpr double kLensShare = 0.18;  // share of the view's shorter side
  return kLensShare * std::min(width, height);
}

void App::Impl::toggleLens() {
  if (view.method != Method::kQsplat) return showToast("The magnifying glass is for splats: method qsplat", false);
  if (lens)
    lens.reset();
  else
    lens = glm::dvec2(0.5 * width, 0.5 * height);
  lens_pointer = -1;
  dirty = true;
  overlayChanged();
}

bool App::Impl::grabLens(const PointerEvent& event) {
  if (!ready() || !lens || lens_pointer >= 0 || event.button != PointerButton::kLeft) return false;
  if (glm::length(*lens - glm::dvec2(event.x, event.y)) > lensRadius()) return false;
  lens_pointer = event.id;
  dragLens(event);
  return true;
}

void App::Impl::dragLens(const PointerEvent& event) {
  lens = glm::clamp(glm::dvec2(event.x, event.y), glm::dvec2(0.0), glm::dvec2(width, height));
  dirty = true;
  overlayChanged();
}

// ---- notes ----

void App::Impl::openCard(std::optional<std::size_t> index) {
  if (index && *index >= annotations.size()) index.reset();
  open_annotation = index;
  overlayChanged();
  if (!index || !annotations[*index].camera || !ready()) return;
  const base::ViewCamera& camera = *annotations[*index].camera;
  const double depth = glm::dot(annotations[*index].position - camera.position, camera.direction);
  moveTo({camera.position, camera.direction, depth > 0.0 ? depth : control.viewpoint().distance}, true);
}

void App::Impl::stepAnnotation(int by) {
  if (annotations.empty()) return showToast("This scene has no notes", false);
  const auto count = static_cast<std::ptrdiff_t>(annotations.size());
  const std::ptrdiff_t from = open_annotation ? static_cast<std::ptrdiff_t>(*open_annotation)
                                              : (by > 0 ? std::ptrdiff_t{-1} : std::ptrdiff_t{0});
  openCard(static_cast<std::size_t>((from + by + count) % count));
}

// ---- keys ----

/// Closes the innermost thing that is open; returns false when there is none.
bool App::Impl::closeInnermost() {
  if (help) {
    help = false;
  } else if (open_annotation) {
    open_annotation.reset();
  } else if (mode != Mode::kLook) {
    setMode(Mode::kLook);
  } else if (lens) {
    toggleLens();
  } else if (view.section.on) {
    view.section.on = false;
    cameraMoved();
  } else {
    return false;
  }
  dirty = true;
  overlayChanged();
  return true;
}

void App::Impl::useBookmark(int slot, bool store) {
  const std::string number = std::to_string(slot);
  std::string& link = bookmarks[static_cast<std::size_t>(slot)];
  if (!ready()) return;
  if (slot == 0) {
    if (store) return showToast("0 is always the first view; 1 to 9 can be set", false);
    return moveTo(control.firstViewpoint(), true);
  }
  if (store) {
    link = formatPermalink(view);
    requests.push_back({.kind = RequestKind::kKeepBookmarks});
    return showToast("Bookmark " + number + " set", false);
  }
  const auto wanted = parsePermalink(link);
  if (!wanted) return showToast("Bookmark " + number + " is empty; shift + " + number + " sets it", false);
  showView(*wanted, false, true);
}

bool App::Impl::pressKey(Key key, Modifiers modifiers) {
  if (key >= Key::k0 && key <= Key::k9) {
    useBookmark(static_cast<int>(key) - static_cast<int>(Key::k0), modifiers.shift || modifiers.ctrl);
    return true;
  }
  // All other keys with ctrl belong to the system: copy, print, reload.
  if (modifiers.ctrl || modifiers.alt) return false;
  if (key == Key::kEscape) return closeInnermost();
  if (key == Key::kH) {
    help = !help;
    overlayChanged();
    return true;
  }
  if (!ready()) return false;
  switch (key) {
    case Key::kF:
      moveTo(control.framingViewpoint(), true);
      break;
    case Key::kR:
    case Key::kHome:
      moveTo(control.firstViewpoint(), true);
      break;
    case Key::kI:
      view.statistics = !view.statistics;
      last_motion = now;
      overlayChanged();
      break;
    case Key::kC:
      view.colors_by_resolution = !view.colors_by_resolution;
      cameraMoved();
      break;
    case Key::kO:
      control.setOrthographic(!control.orthographic());
      cameraMoved();
      break;
    case Key::kL:
      toggleLens();
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
      overlayChanged();
      break;
    case Key::kG:
      requests.push_back({.kind = RequestKind::kShowSettings});
      break;
    case Key::kV:
      requests.push_back({.kind = RequestKind::kCopyLink, .text = formatPermalink(view)});
      break;
    case Key::kP: {
      const base::ViewCamera camera = drawnCamera();
      const auto tolerance = static_cast<double>(viewer.options().session.patch_tolerance_px);
      requests.push_back(
          {.kind = RequestKind::kSavePicture, .text = pictureQuery(camera, view, tolerance), .camera = camera});
      break;
    }
    default:
      return false;
  }
  return true;
}

}  // namespace client
