#include "client/app/app_impl.h"

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

void App::Impl::showToast(std::string text, bool error) {
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
  overlayChanged();
}

void App::Impl::expireToasts() {
  for (std::size_t i = toasts.size(); i-- > 0;) {
    if (toast_ends[i] > now) continue;
    toasts.erase(toasts.begin() + static_cast<std::ptrdiff_t>(i));
    toast_ends.erase(toast_ends.begin() + static_cast<std::ptrdiff_t>(i));
    overlayChanged();
  }
}

// ---- labels and lines ----

Label App::Impl::labelAt(LabelKind kind, std::size_t index, const glm::dvec3& world) const {
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

void App::Impl::addPins() {
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

/// Adds a line, clipped in front of the eye.
void App::Impl::addLine(const glm::dvec3& a, const glm::dvec3& b, bool approximate) {
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

void App::Impl::addMeasurements() {
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

/// Adds the rim of the magnifying glass as a polygon.
void App::Impl::addLens() {
  if (!lens) return;
  constexpr int kSides = 64;
  const auto rim = [this](int side) {
    const double turn = glm::two_pi<double>() * side / kSides;
    return *lens + lensRadius() * glm::dvec2(std::cos(turn), std::sin(turn));
  };
  for (int i = 0; i < kSides; ++i) {
    const glm::dvec2 a = rim(i);
    const glm::dvec2 b = rim(i + 1);
    lines.push_back({a.x, a.y, b.x, b.y, false});
  }
}

void App::Impl::refreshOverlay() {
  overlay_dirty = false;
  labels.clear();
  lines.clear();
  if (!ready() || width <= 0) return;
  addPins();
  addMeasurements();
  addLens();
  if (view.section.on) labels.push_back(labelAt(LabelKind::kSectionHandle, 0, sectionHandle()));
}

/// Takes over the viewer's answers about pins, which come a frame or two late.
void App::Impl::readPinAnswers() {
  if (annotations.empty() || options.surface) return;
  const std::vector<bool>& visible = viewer.pinsVisible();
  if (visible == pins_visible) return;
  pins_visible = visible;
  overlayChanged();
}

/// Without GL no pin is known to be hidden.
bool App::Impl::pinHidden(std::size_t index) const {
  if (options.surface) return false;
  return index >= pins_visible.size() || !pins_visible[index];
}

// ---- connection and progress ----

Status App::Impl::status() const {
  const Session& session = viewer.session();
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
  return {viewer.stats().complete ? Status::Kind::kReady : Status::Kind::kLoading, "", ""};
}

void App::Impl::updateProgress() {
  const Status present = status();
  if (present.kind != last_status.kind || present.text != last_status.text) overlayChanged();
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

    // The shape's share grows with the logarithm of its error; the images come after it.
    double share = 0.0;
    if (stats.lumigraph.triangles > 0) {
      const double goal = std::max(static_cast<double>(viewer.options().session.patch_tolerance_px), 0.1);
      const double whole = std::log(std::max(static_cast<double>(first_error), goal) / goal);
      const double open = std::log(std::max(static_cast<double>(stats.error_px), goal) / goal);
      share = kShapeShare * (whole > 0.0 ? 1.0 - open / whole : 1.0);
      const double used = stats.lumigraph.samples_used;
      if (open <= 0.0 && used > 0.0) share += (0.95 - kShapeShare) * used / (used + stats.images_requested);
    } else if (stats.splats.splats > 0) {
      const auto lacking = static_cast<double>(stats.splats.stream.wanted + stats.splats.stream.requested);
      share = 1.0 - lacking / (lacking + static_cast<double>(stats.splats.stream.present));
    }
    progress.active = now - incomplete_since >= kProgressSeconds;
    progress.share = std::max(progress.share, share);
  }
  if (before.active != progress.active || (progress.active && before.share != progress.share)) ++overlay_version;
}

}  // namespace client
