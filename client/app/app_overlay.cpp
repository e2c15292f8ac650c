#include "client/app/app.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <utility>

namespace client {
namespace {

/// These times and numbers are choices of design. No progress bar is shown for loading that takes less than this,
/// seconds; notices go after kToastSeconds, errors, which are longer to read, after kErrorSeconds.
constexpr double kProgressSeconds = 0.5;
constexpr double kToastSeconds = 3.5;
constexpr double kErrorSeconds = 8.0;
constexpr std::size_t kMaxToasts = 3;
/// Share of the progress bar that the shape takes; the images take the rest. A choice: how many bytes of each come is
/// not known beforehand.
constexpr double kShapeShare = 0.6;

}  // namespace

// ---- toasts ----

void App::showToast(std::string text, bool error) {
  if (!toasts_.empty() && toasts_.back().text == text) toasts_.pop_back();
  toasts_.push_back({next_toast_++, std::move(text), error, now_ + (error ? kErrorSeconds : kToastSeconds)});
  if (toasts_.size() > kMaxToasts) toasts_.erase(toasts_.begin());
  overlayChanged();
}

void App::expireToasts() {
  if (std::erase_if(toasts_, [this](const Toast& toast) { return toast.until <= now_; }) > 0) overlayChanged();
}

// ---- labels and lines ----

Label App::labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const {
  const ScreenPoint at = control_.project(world);
  Label label;
  label.kind = kind;
  label.index = static_cast<std::uint32_t>(index);
  label.x = at.x;
  label.y = at.y;
  label.visible =
      (at.depth > 0.0 || control_.orthographic()) && at.x >= 0.0 && at.x <= width_ && at.y >= 0.0 && at.y <= height_;
  return label;
}

void App::addPins() {
  for (std::size_t i = 0; i < annotations_.size(); ++i) {
    Label label = labelAt(LabelKind::kPin, i, annotations_[i].position);
    label.text = annotations_[i].title;
    label.open = open_annotation_ == i;
    const glm::dvec3 towards_eye =
        control_.orthographic() ? -control_.camera().direction : control_.camera().position - annotations_[i].position;
    const bool turned_away = glm::dot(annotations_[i].normal, towards_eye) < 0.0;
    if (turned_away || pinHidden(i) || hiddenBySection(annotations_[i].position)) label.visible = false;
    labels_.push_back(std::move(label));
  }
}

/// Adds a line, clipped in front of the eye.
void App::addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate) {
  const glm::dvec3& eye = control_.camera().position;
  const glm::dvec3& axis = control_.camera().direction;
  const double nearest = 1e-6 * control_.sceneSize();
  double depth_a = glm::dot(a - eye, axis);
  double depth_b = glm::dot(b - eye, axis);
  glm::dvec3 from = a;
  glm::dvec3 to = b;
  if (!control_.orthographic()) {
    if (depth_a < nearest && depth_b < nearest) return;
    if (depth_a < nearest) from = b + (a - b) * ((depth_b - nearest) / (depth_b - depth_a));
    if (depth_b < nearest) to = a + (b - a) * ((depth_a - nearest) / (depth_a - depth_b));
  }
  const ScreenPoint p = control_.project(from);
  const ScreenPoint q = control_.project(to);
  lines_.push_back({p.x, p.y, q.x, q.y, approximate});
}

void App::addMeasurements() {
  std::size_t point_index = 0;
  std::size_t value_index = 0;
  for (const Measurement& one : measure_.all()) {
    for (std::size_t i = 0; i < one.points.size(); ++i) {
      Label label = labelAt(LabelKind::kPoint, point_index++, one.points[i].position);
      label.approximate = one.points[i].approximate;
      labels_.push_back(std::move(label));
      if (i > 0)
        addLine(one.points[i - 1].position, one.points[i].position,
                one.points[i - 1].approximate || one.points[i].approximate);
    }
    for (const MeasuredValue& value : measuredValues(one, framed_->units)) {
      Label label = labelAt(LabelKind::kValue, value_index++, value.at);
      label.approximate = value.approximate;
      label.text = value.text;
      labels_.push_back(std::move(label));
    }
  }
}

/// Adds the rim of the magnifying glass as a polygon.
void App::addLens() {
  if (!lens_) return;
  constexpr int kSides = 64;
  const auto rim = [this](int side) {
    const double turn = glm::two_pi<double>() * side / kSides;
    return *lens_ + lensRadius() * glm::dvec2(std::cos(turn), std::sin(turn));
  };
  for (int i = 0; i < kSides; ++i) {
    const glm::dvec2 a = rim(i);
    const glm::dvec2 b = rim(i + 1);
    lines_.push_back({a.x, a.y, b.x, b.y, false});
  }
}

/// Adds the handle of the light, a sun.
void App::addLight() {
  if (!view_.light.on) return;
  constexpr int kRays = 12;
  constexpr double kInner = 7.0, kOuter = 12.0;  // points
  const glm::dvec2 at = lightHandle();
  for (int i = 0; i < kRays; ++i) {
    const auto towards = [&](int ray) {
      const double turn = glm::two_pi<double>() * ray / kRays;
      return pixel_ratio_ * glm::dvec2(std::cos(turn), std::sin(turn));
    };
    const glm::dvec2 a = at + kInner * towards(i), b = at + kInner * towards(i + 1), c = at + kOuter * towards(i);
    lines_.push_back({a.x, a.y, b.x, b.y, false});
    lines_.push_back({a.x, a.y, c.x, c.y, false});
  }
}

void App::refreshOverlay() {
  overlay_dirty_ = false;
  labels_.clear();
  lines_.clear();
  if (!ready() || width_ <= 0) return;
  addPins();
  addMeasurements();
  addLens();
  addLight();
  if (view_.section.on) labels_.push_back(labelAt(LabelKind::kSectionHandle, 0, sectionHandle()));
}

/// Takes over the viewer's answers about pins, which come a frame or two late.
void App::readPinAnswers() {
  if (annotations_.empty() || options_.surface) return;
  const std::vector<bool>& visible = viewer_.pinsVisible();
  if (visible == pins_visible_) return;
  pins_visible_ = visible;
  overlayChanged();
}

/// Without GL no pin is known to be hidden.
bool App::pinHidden(std::size_t index) const {
  return !options_.surface && (index >= pins_visible_.size() || !pins_visible_[index]);
}

// ---- connection and progress ----

Status App::status() const {
  const Session& session = viewer_.session();
  const std::string& problem = session.problem();
  switch (session.phase()) {
    case SessionPhase::kRefused:
      return {Status::Kind::kRefused, problem, "When that is mended, open the scene again."};
    case SessionPhase::kDisconnected:
      if (problem.empty()) return {Status::Kind::kConnecting, "", ""};
      return {Status::Kind::kLost, problem,
              ready() ? "Trying again; what is here can be looked at meanwhile." : "Trying again."};
    case SessionPhase::kGreeting:
      return {Status::Kind::kConnecting, "", ""};
    case SessionPhase::kReady:
      break;
  }
  return {viewer_.stats().complete ? Status::Kind::kReady : Status::Kind::kLoading, "", ""};
}

void App::updateProgress() {
  const Status present = status();
  if (present.kind != last_status_.kind || present.text != last_status_.text) overlayChanged();
  last_status_ = present;
  const bool loading = present.kind == Status::Kind::kLoading || present.kind == Status::Kind::kConnecting;
  const Progress before = progress_;
  if (!loading) {
    progress_ = {};
    incomplete_since_ = -1.0;
  } else {
    const ViewerStats stats = viewer_.stats();
    if (incomplete_since_ < 0.0) {
      incomplete_since_ = now_;
      first_error_ = 0.0F;
    }
    first_error_ = std::max(first_error_, stats.error_px);

    // The shape's share grows with the logarithm of its error; the images come after it.
    double share = 0.0;
    if (stats.lumigraph.triangles > 0) {
      const double goal = std::max(static_cast<double>(viewer_.session().usualPatches().tolerance_px), 0.1);
      const double whole = std::log(std::max(static_cast<double>(first_error_), goal) / goal);
      const double open = std::log(std::max(static_cast<double>(stats.error_px), goal) / goal);
      share = kShapeShare * (whole > 0.0 ? 1.0 - open / whole : 1.0);
      const double used = stats.lumigraph.samples_used;
      if (open <= 0.0 && used > 0.0) share += (0.95 - kShapeShare) * used / (used + stats.images_requested);
    } else if (stats.streamed.drawn > 0) {
      const auto lacking = static_cast<double>(stats.streamed.lacking);
      share = 1.0 - lacking / (lacking + static_cast<double>(stats.streamed.present));
    }
    progress_.active = now_ - incomplete_since_ >= kProgressSeconds;
    progress_.share = std::max(progress_.share, share);
  }
  if (before.active != progress_.active || (progress_.active && before.share != progress_.share)) ++overlay_version_;
}

}  // namespace client
