#include "client/app/measure.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "base/format_text.h"

namespace client {
namespace {

// Digits that a length shows at most, a choice: more than any scan's accuracy is worth.
constexpr int kMaxDecimals = 12;
constexpr int kMaxDigits = 9;
constexpr int kDigitsUnknown = 6;  // significant digits where no accuracy is known

int exponentOf(double value) {
  return static_cast<int>(std::floor(std::log10(value)));
}

std::string fixed(double value, int decimals) {
  return base::formatText("%.*f", decimals, value);
}

/// Returns the number of decimals that ends at the first digit of the accuracy.
int decimalsFor(double value, double accuracy) {
  const int lead = value > 0.0 ? exponentOf(value) : 0;
  const int wanted = accuracy > 0.0 ? -exponentOf(accuracy) : kDigitsUnknown - 1 - lead;
  return std::clamp(std::min(wanted, kMaxDigits - 1 - std::max(lead, 0)), 0, kMaxDecimals);
}

std::string formatValue(double value, double accuracy, bool approximate, const std::string& unit) {
  const int decimals = decimalsFor(value, accuracy);
  if (approximate) return "about " + fixed(value, decimals) + unit;
  std::string text = fixed(value, decimals) + unit;
  if (accuracy <= 0.0) return text;
  // The accuracy is rounded up, since it is a bound.
  const double step = std::pow(10.0, -decimals);
  return text + " \u00B1 " + fixed(std::ceil(accuracy / step - 1e-9) * step, decimals) + unit;
}

MeasuredValue segment(const MeasuredPoint& a, const MeasuredPoint& b, const std::string& unit) {
  MeasuredValue value;
  value.at = 0.5 * (a.position + b.position);
  value.value = glm::length(b.position - a.position);
  value.accuracy = a.accuracy + b.accuracy;
  value.approximate = a.approximate || b.approximate;
  value.text = formatLength(value.value, value.accuracy, value.approximate, unit);
  return value;
}

/// Returns the largest angle by which an arm may turn when its ends may move by `accuracy` together.
double turn(double length, double accuracy) {
  return accuracy < length ? std::asin(accuracy / length) : glm::pi<double>();
}

MeasuredValue angle(const MeasuredPoint& a, const MeasuredPoint& corner, const MeasuredPoint& b) {
  const glm::dvec3 arm_a = a.position - corner.position;
  const glm::dvec3 arm_b = b.position - corner.position;
  MeasuredValue value;
  value.at = corner.position;
  value.value = std::atan2(glm::length(glm::cross(arm_a, arm_b)), glm::dot(arm_a, arm_b));
  value.accuracy = std::min(
      turn(glm::length(arm_a), a.accuracy + corner.accuracy) + turn(glm::length(arm_b), b.accuracy + corner.accuracy),
      glm::pi<double>());
  value.approximate = a.approximate || corner.approximate || b.approximate;
  value.text = formatAngle(value.value, value.accuracy, value.approximate);
  return value;
}

}  // namespace

std::vector<MeasuredValue> measuredValues(const Measurement& measurement, const std::string& unit) {
  const std::vector<MeasuredPoint>& points = measurement.points;
  std::vector<MeasuredValue> values;
  if (measurement.kind == MeasureKind::kAngle) {
    if (points.size() >= 3) values.push_back(angle(points[0], points[1], points[2]));
    return values;
  }

  MeasuredValue total;
  for (std::size_t i = 1; i < points.size(); ++i) {
    values.push_back(segment(points[i - 1], points[i], unit));
    total.value += values.back().value;
    total.accuracy += values.back().accuracy;
    total.approximate |= values.back().approximate;
  }
  if (values.size() < 2) return values;
  total.at = points.back().position;
  total.total = true;
  total.text = "total " + formatLength(total.value, total.accuracy, total.approximate, unit);
  values.push_back(total);
  return values;
}

std::string formatLength(double value, double accuracy, bool approximate, const std::string& unit) {
  return formatValue(value, accuracy, approximate, unit.empty() || unit == "unknown" ? " units" : " " + unit);
}

std::string formatAngle(double radians, double accuracy, bool approximate) {
  return formatValue(glm::degrees(radians), glm::degrees(accuracy), approximate, "\u00B0");
}

// ---- the tool ----

void MeasureTool::start(MeasureKind kind) {
  finish();
  kind_ = kind;
}

bool MeasureTool::full() const {
  std::size_t count = 0;
  for (const Measurement& one : all_) count += one.points.size();
  return count >= kMaxMeasuredPoints;
}

bool MeasureTool::add(const MeasuredPoint& point) {
  if (full()) return false;
  if (all_.empty() || all_.back().finished) all_.push_back({kind_, {}, false});
  Measurement& running = all_.back();
  if (!running.points.empty() && running.points.back().position == point.position) return false;
  running.points.push_back(point);
  if (running.kind == MeasureKind::kAngle && running.points.size() == 3) running.finished = true;
  return true;
}

/// Ends the running measurement; one without enough points to measure anything is removed.
void MeasureTool::finish() {
  if (all_.empty()) return;
  Measurement& running = all_.back();
  running.finished = true;
  if (running.points.size() < 2 || (running.kind == MeasureKind::kAngle && running.points.size() < 3)) all_.pop_back();
}

void MeasureTool::removeLast() {
  if (all_.empty()) return;
  all_.back().points.pop_back();
  all_.back().finished = false;
  if (all_.back().points.empty()) all_.pop_back();
}

bool MeasureTool::answer(std::uint32_t pick_id, const PickAnswer& answer) {
  for (Measurement& one : all_)
    for (MeasuredPoint& point : one.points) {
      if (point.pick_id != pick_id || pick_id == 0) continue;
      point.pick_id = 0;
      if (answer.kind == PickAnswer::Kind::kHit)
        point = {answer.point, answer.normal, std::max(answer.accuracy, 0.0), false, 0};
      return true;
    }
  return false;
}

}  // namespace client
