#include "base/format_text.h"
#include "client/app/app.h"

#include <algorithm>
#include <cmath>

#include "client/app/permalink.h"

namespace client {
namespace {

/// Writes a number so that it reads back as the same double.
std::string exact(double value) {
  return base::formatText("%.17g", value);
}

std::string exact(const glm::dvec3& v) {
  return exact(v.x) + "," + exact(v.y) + "," + exact(v.z);
}

/// Returns the query of /render (docs/formats/http.md) for the present view, without size and background, which the
/// platform adds. `tolerance_px` and `measure` are those of the viewer's patches: a picture tinted by resolution shows
/// these, any other the full resolution.
std::string pictureQuery(const base::ViewCamera& camera, const ViewState& view, double tolerance_px,
                         base::ErrorMeasure measure) {
  std::string query = "position=" + exact(camera.position) + "&direction=" + exact(camera.direction) +
                      "&up=" + exact(camera.up) + "&fov_y=" + exact(camera.fov_y);
  if (camera.orthographic()) query += "&ortho_height=" + exact(camera.ortho_height);
  if (view.section.on)
    query += std::string("&section=") + static_cast<char>('x' + view.section.axis) + "," + exact(view.section.offset) +
             (view.section.keep_below ? ",b" : ",a");
  if (view.light.on) query += "&light=" + exact(view.light.direction());
  if (view.colors_by_resolution) query += "&colors=resolution&tolerance=" + exact(tolerance_px);
  if (view.colors_by_resolution && measure != base::ErrorMeasure::kVisible)
    query += measure == base::ErrorMeasure::kShape ? "&measure=shape" : "&measure=bound";
  return query;
}

}  // namespace

// ---- gestures ----

void App::applyGesture(const Gesture& g) {
  if (!ready()) return;
  flight_.end();
  switch (g.kind) {
    case GestureKind::kOrbit:
      control_.orbit(g.dx * settings_.orbit_speed, g.dy * settings_.orbit_speed);
      break;
    case GestureKind::kGrab:
      control_.grab(g.x, g.y, surfaceAt(g.x, g.y));
      return;
    case GestureKind::kPan:
      control_.dragTo(g.x, g.y);
      break;
    case GestureKind::kPinch: {
      // A pinch by this ratio equals one wheel step: the inverse of the 0.8 by which a step scales the distance.
      constexpr double kRatioPerStep = 1.25;
      control_.zoom(std::log(g.factor) / std::log(kRatioPerStep), g.x, g.y, control_.grabbed());
      break;
    }
    case GestureKind::kClick:
    case GestureKind::kDoubleClick:
      handleClick(g);
      return;
  }
  cameraMoved();
}

void App::handleClick(const Gesture& g) {
  const bool twice = g.kind == GestureKind::kDoubleClick;
  if (mode_ != Mode::kLook) {
    if (twice && mode_ == Mode::kDistance) {
      measure_.finish();
      overlayChanged();
    } else {
      measureAt(g.x, g.y);
    }
    return;
  }
  if (const auto pin = pinAt(g.x, g.y, g.pointer)) {
    if (!twice) showAnnotation(pin);
    return;
  }
  if (twice) setPivotAt(g.x, g.y);
}

void App::setPivotAt(double x, double y) {
  if (const auto surface = surfaceAt(x, y)) moveTo(control_.viewpointCentredOn(*surface), true);
}

/// Radius around a pin or handle within which a press hits it: wider for fingers and pens than for mice.
double App::pickRadius(PointerKind kind) const {
  constexpr double kMouse = 12.0, kFinger = 24.0;  // screen units
  return pixel_ratio_ * (kind == PointerKind::kMouse ? kMouse : kFinger);
}

/// Returns the nearest visible pin within reach.
std::optional<std::size_t> App::pinAt(double x, double y, PointerKind kind) const {
  std::optional<std::size_t> found;
  double nearest = pickRadius(kind);
  for (const Label& label : labels_) {
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
void App::zoom(double steps, double x, double y) {
  constexpr double kWheelSeconds = 0.4;
  if (!ready() || steps == 0.0) return;
  flight_.end();
  WheelTarget& target = wheel_target_;
  const bool same = now_ - target.at < kWheelSeconds && std::hypot(target.x - x, target.y - y) <= 2.0 * pixel_ratio_;
  if (!same) target.surface = surfaceAt(x, y);
  target.at = now_;
  target.x = x;
  target.y = y;
  control_.zoom(steps * settings_.zoom_speed, x, y, target.surface);
  cameraMoved();
}

// ---- measuring ----

void App::cycleMeasure() {
  setMode(mode_ == Mode::kLook ? Mode::kDistance : mode_ == Mode::kDistance ? Mode::kAngle : Mode::kLook);
}

void App::setMode(Mode wanted) {
  mode_ = wanted;
  if (mode_ == Mode::kLook)
    measure_.clear();
  else
    measure_.start(mode_ == Mode::kDistance ? MeasureKind::kDistance : MeasureKind::kAngle);
  dirty_ = true;
  overlayChanged();
}

/// Returns the ray through a pixel, beginning where the section no longer cuts it off.
Ray App::pickRay(double x, double y) const {
  Ray ray = control_.rayAt(x, y);
  if (!hiddenBySection(ray.origin)) return ray;
  const double towards = ray.direction[view_.section.axis];
  const double gap = view_.section.offset - ray.origin[view_.section.axis];
  if (gap * towards > 0.0) ray.origin += gap / towards * ray.direction;
  return ray;
}

void App::measureAt(double x, double y) {
  const auto surface = surfaceAt(x, y);
  if (!surface) return showToast("There is no surface at this place", false);

  // Use the point on the screen until the answer arrives.
  MeasuredPoint point;
  point.position = *surface;
  point.accuracy = control_.pixelSizeAt(*surface) * (0.5 + static_cast<double>(viewer_.stats().bound_px));
  point.pick_id = next_pick_;
  if (!measure_.add(point)) {
    if (measure_.full()) showToast("There are too many points; Escape clears them", false);
    return;
  }
  const Ray ray = pickRay(x, y);
  requests_.push_back(
      {.kind = RequestKind::kPick, .id = next_pick_++, .origin = ray.origin, .direction = ray.direction});
  dirty_ = true;
  overlayChanged();
}

// ---- the section plane ----

bool App::hiddenBySection(const glm::dvec3& world) const {
  const Section& s = view_.section;
  if (!s.on) return false;
  // A rounding error on the hidden side counts as on the plane.
  const double beyond = (world[s.axis] - s.offset) * (s.keep_below ? 1.0 : -1.0);
  return beyond > 1e-9 * control_.sceneSize();
}

/// Returns the axes in the order in which X goes through them: the scene's up axis first, then the other two.
int App::sectionAxis(int place) const {
  const glm::vec3 up = glm::abs(framed_->up);
  const int first = up.x > up.y && up.x > up.z ? 0 : up.y > up.z ? 1 : 2;
  return (first + place) % 3;
}

void App::cycleSection() {
  int place = 0;
  if (view_.section.on)
    while (sectionAxis(place++) != view_.section.axis) {
    }
  if (place == 3) {
    view_.section.on = false;
    cameraMoved();
    return;
  }
  turnOnSection(sectionAxis(place));
}

/// Puts the plane through the middle of the model and cuts off the near half.
void App::turnOnSection(int axis) {
  view_.section = {true, axis, control_.camera().direction[axis] < 0.0, control_.boxCenter()[axis]};
  cameraMoved();
}

void App::moveSection(double distance) {
  Section& s = view_.section;
  s.offset = std::clamp(s.offset + distance, control_.boxMin()[s.axis], control_.boxMax()[s.axis]);
}

glm::dvec3 App::sectionHandle() const {
  glm::dvec3 place = control_.boxCenter();
  place[view_.section.axis] = view_.section.offset;
  return place;
}

bool App::grabHandle(const PointerEvent& event) {
  if (!ready() || !view_.section.on || handle_pointer_ >= 0 || event.button != PointerButton::kLeft) return false;
  const ScreenPoint at = control_.project(sectionHandle());
  if (at.depth <= 0.0 && !control_.orthographic()) return false;
  if (std::hypot(at.x - event.x, at.y - event.y) > pickRadius(event.kind)) return false;
  handle_pointer_ = event.id;
  handle_at_ = {event.x, event.y};
  return true;
}

/// Moves the plane with the pointer along its axis as seen on the screen. When the axis points at the viewer, up and
/// down move it.
void App::dragHandle(const PointerEvent& event) {
  const glm::dvec2 drag = glm::dvec2(event.x, event.y) - handle_at_;
  handle_at_ = {event.x, event.y};
  const glm::dvec3 place = sectionHandle();
  const double pixel = control_.pixelSizeAt(place);
  if (pixel <= 0.0) return;
  glm::dvec3 further = place;
  further[view_.section.axis] += pixel;
  const ScreenPoint a = control_.project(place);
  const ScreenPoint b = control_.project(further);
  const glm::dvec2 along(
      b.x - a.x, b.y - a.y);  // pixels by which the handle moves on the screen when the plane moves by one pixel's size
  const double length = glm::length(along);
  moveSection(length > 0.1 ? pixel * glm::dot(drag, along) / (length * length) : -pixel * drag.y);
  cameraMoved();
}

// ---- the viewer's own light ----

namespace {

/// The light's handle moves within a disc around the picture's middle: there the light comes from the eye, at the rim
/// it grazes what faces the eye. Share of the view's shorter side.
constexpr double kLightDisc = 0.4;
/// The light comes from the eye's side by at least so much, a cosine: else nothing that faces the eye were lit.
constexpr double kLeastTowardsEye = 0.03;

}  // namespace

/// Turns the light on from above left, or off.
void App::toggleLight() {
  light_pointer_ = -1;
  view_.light.on = !view_.light.on;
  constexpr double kBeside = 0.5;
  const double reach = kBeside * kLightDisc * std::min(width_, height_);
  if (view_.light.on && ready()) dragLight(0.5 * width_ - reach, 0.5 * height_ - reach);
  cameraMoved();
}

/// The place of the light's handle, framebuffer pixels. A light from behind has it at the rim.
glm::dvec2 App::lightHandle() const {
  const glm::dvec3 light = view_.light.direction();
  glm::dvec2 at(glm::dot(light, control_.right()), -glm::dot(light, control_.upInView()));
  const double length = glm::length(at);
  if (glm::dot(light, view_.direction) > 0.0 && length > 0.0) at /= length;
  return 0.5 * glm::dvec2(width_, height_) + kLightDisc * std::min(width_, height_) * at;
}

bool App::grabLight(const PointerEvent& event) {
  if (!ready() || !view_.light.on || light_pointer_ >= 0 || event.button != PointerButton::kLeft) return false;
  if (glm::length(lightHandle() - glm::dvec2(event.x, event.y)) > 2.0 * pickRadius(event.kind)) return false;
  light_pointer_ = event.id;
  return true;
}

void App::dragLight(double x, double y) {
  const double reach = kLightDisc * std::min(width_, height_);
  glm::dvec2 at = (glm::dvec2(x, y) - 0.5 * glm::dvec2(width_, height_)) / reach;
  const double most = std::sqrt(1.0 - kLeastTowardsEye * kLeastTowardsEye);
  if (glm::length(at) > most) at *= most / glm::length(at);
  const glm::dvec3 light = at.x * control_.right() - at.y * control_.upInView() -
                           std::sqrt(std::max(0.0, 1.0 - glm::dot(at, at))) * view_.direction;
  view_.light = OwnLight::towards(light);
  cameraMoved();
}

// ---- the magnifying glass ----

double App::lensRadius() const {
  constexpr double kLensShare = 0.18;  // share of the view's shorter side
  return kLensShare * std::min(width_, height_);
}

void App::toggleLens() {
  if (lens_)
    lens_.reset();
  else
    lens_ = glm::dvec2(0.5 * width_, 0.5 * height_);
  lens_pointer_ = -1;
  dirty_ = true;
  overlayChanged();
}

bool App::grabLens(const PointerEvent& event) {
  if (!ready() || !lens_ || lens_pointer_ >= 0 || event.button != PointerButton::kLeft) return false;
  if (glm::length(*lens_ - glm::dvec2(event.x, event.y)) > lensRadius()) return false;
  lens_pointer_ = event.id;
  dragLens(event);
  return true;
}

void App::dragLens(const PointerEvent& event) {
  lens_ = glm::clamp(glm::dvec2(event.x, event.y), glm::dvec2(0.0), glm::dvec2(width_, height_));
  dirty_ = true;
  overlayChanged();
}

// ---- notes ----

void App::showAnnotation(std::optional<std::size_t> index) {
  if (index && *index >= annotations_.size()) index.reset();
  open_annotation_ = index;
  overlayChanged();
  if (!index || !annotations_[*index].camera || !ready()) return;
  const base::ViewCamera& camera = *annotations_[*index].camera;
  const double depth = glm::dot(annotations_[*index].position - camera.position, camera.direction);
  moveTo({camera.position, camera.direction, depth > 0.0 ? depth : control_.viewpoint().distance}, true);
}

void App::stepAnnotation(int by) {
  if (annotations_.empty()) return showToast("This scene has no notes", false);
  const auto count = static_cast<std::ptrdiff_t>(annotations_.size());
  const std::ptrdiff_t from = open_annotation_ ? static_cast<std::ptrdiff_t>(*open_annotation_)
                                               : (by > 0 ? std::ptrdiff_t{-1} : std::ptrdiff_t{0});
  showAnnotation(static_cast<std::size_t>((from + by + count) % count));
}

// ---- keys ----

/// Closes the innermost thing that is open; returns false when there is none.
bool App::closeInnermost() {
  if (help_) {
    help_ = false;
  } else if (open_annotation_) {
    open_annotation_.reset();
  } else if (mode_ != Mode::kLook) {
    setMode(Mode::kLook);
  } else if (lens_) {
    toggleLens();
  } else if (view_.section.on) {
    view_.section.on = false;
    cameraMoved();
  } else {
    return false;
  }
  dirty_ = true;
  overlayChanged();
  return true;
}

void App::useBookmark(int slot, bool store) {
  const std::string number = std::to_string(slot);
  std::string& link = bookmarks_[static_cast<std::size_t>(slot)];
  if (!ready()) return;
  if (slot == 0) {
    if (store) return showToast("0 is always the first view; 1 to 9 can be set", false);
    return moveTo(control_.firstViewpoint(), true);
  }
  if (store) {
    link = formatPermalink(view_);
    requests_.push_back({.kind = RequestKind::kKeepBookmarks});
    return showToast("Bookmark " + number + " set", false);
  }
  const auto wanted = parsePermalink(link);
  if (!wanted) return showToast("Bookmark " + number + " is empty; shift + " + number + " sets it", false);
  showView(*wanted, false, true);
}

bool App::pressKey(Key key, Modifiers modifiers) {
  if (key >= Key::k0 && key <= Key::k9) {
    useBookmark(static_cast<int>(key) - static_cast<int>(Key::k0), modifiers.shift || modifiers.ctrl);
    return true;
  }
  // All other keys with ctrl belong to the system: copy, print, reload.
  if (modifiers.ctrl || modifiers.alt) return false;
  if (key == Key::kEscape) return closeInnermost();
  if (key == Key::kH) {
    help_ = !help_;
    overlayChanged();
    return true;
  }
  if (!ready()) return false;
  switch (key) {
    case Key::kF:
      moveTo(control_.framingViewpoint(), true);
      break;
    case Key::kR:
    case Key::kHome:
      moveTo(control_.firstViewpoint(), true);
      break;
    case Key::kI:
      view_.statistics = !view_.statistics;
      last_motion_ = now_;
      overlayChanged();
      break;
    case Key::kC:
      view_.colors_by_resolution = !view_.colors_by_resolution;
      cameraMoved();
      break;
    case Key::kO:
      control_.setOrthographic(!control_.orthographic());
      cameraMoved();
      break;
    case Key::kL:
      if (view_.method == Method::kQsplat && !modifiers.shift)
        toggleLens();
      else
        toggleLight();
      break;
    case Key::kM:
      cycleMeasure();
      break;
    case Key::kX:
      if (modifiers.shift && view_.section.on) {
        view_.section.keep_below = !view_.section.keep_below;
        cameraMoved();
      } else {
        cycleSection();
      }
      break;
    case Key::kN:
      stepAnnotation(modifiers.shift ? -1 : 1);
      break;
    case Key::kEnter:
      if (mode_ == Mode::kLook)
        setPivotAt(0.5 * width_, 0.5 * height_);
      else
        measureAt(0.5 * width_, 0.5 * height_);
      break;
    case Key::kBackspace:
      if (mode_ == Mode::kLook) return false;
      measure_.removeLast();
      dirty_ = true;
      overlayChanged();
      break;
    case Key::kG:
      requests_.push_back({.kind = RequestKind::kShowSettings});
      break;
    case Key::kV:
      requests_.push_back({.kind = RequestKind::kCopyLink, .text = formatPermalink(view_)});
      break;
    case Key::kP: {
      const base::ViewCamera drawn = camera();
      const PatchGoal goal = viewer_.session().usualPatches();
      requests_.push_back({.kind = RequestKind::kSavePicture,
                           .text = pictureQuery(drawn, view_, static_cast<double>(goal.tolerance_px), goal.measure),
                           .camera = drawn});
      break;
    }
    default:
      return false;
  }
  return true;
}

}  // namespace client
