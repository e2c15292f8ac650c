#include "server/session/motion.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace server {
namespace {

constexpr double kPause = 0.25;   // seconds between two views of one motion at most
constexpr double kSettle = 0.12;  // seconds without a view after which the eye stands; displays send 30 or 60 a second
// Seconds of views that the speed is measured over. Arrivals jitter by milliseconds, which over two neighbours would
// be a tenth of the speed or more.
constexpr double kSpan = 0.1;
constexpr double kMinSpan = 1e-3;  // views nearer to each other in time tell no speed

/// Turns `direction` on about the axis and by the speed at which it came from `before`.
glm::dvec3 turnedOn(const glm::dvec3& before, const glm::dvec3& direction, double times) {
  const glm::dvec3 axis = glm::cross(before, direction);
  const double sine = glm::length(axis);
  if (sine < 1e-12) return direction;
  const double angle = times * std::atan2(sine, glm::dot(before, direction));
  const glm::dvec3 side = glm::cross(axis / sine, direction);
  return glm::normalize(std::cos(angle) * direction + std::sin(angle) * side);
}

}  // namespace

bool Motion::follows(const base::ViewCamera& camera, double seconds) const {
  if (views_.empty() || seconds - views_.back().seconds > kPause) return false;
  const base::ViewCamera& last = views_.back().camera;
  if (camera.width != last.width || camera.height != last.height || camera.fov_y != last.fov_y ||
      camera.section != last.section)
    return false;
  return glm::length(camera.position - last.position) <= reach_ &&
         glm::dot(camera.direction, last.direction) > std::cos(0.5 * camera.fov_y);
}

bool Motion::accept(const base::ViewCamera& camera, double seconds) {
  const bool goes_on = follows(camera, seconds);
  if (!goes_on) views_.clear();
  views_.push_back({camera, seconds});
  while (views_.size() > 2 && seconds - std::next(views_.begin())->seconds >= kSpan) views_.pop_front();
  return goes_on;
}

bool Motion::moving(double now) const {
  if (views_.size() < 2 || now >= settledAt()) return false;
  const Timed& from = views_.front();
  const Timed& to = views_.back();
  if (to.seconds - from.seconds < kMinSpan) return false;
  return from.camera.position != to.camera.position || from.camera.direction != to.camera.direction;
}

double Motion::settledAt() const {
  return newestAt() + kSettle;
}

base::ViewCamera Motion::ahead(double seconds) const {
  const Timed& from = views_.front();
  const Timed& to = views_.back();
  const double times = std::clamp(seconds, 0.0, kMaxAhead) / (to.seconds - from.seconds);
  base::ViewCamera camera = to.camera;
  const glm::dvec3 step = times * (to.camera.position - from.camera.position);
  const double length = glm::length(step);
  camera.position += length > reach_ ? reach_ / length * step : step;
  camera.direction = turnedOn(from.camera.direction, to.camera.direction, times);
  camera.up = turnedOn(from.camera.up, to.camera.up, times);
  // An up vector that would become parallel to the direction turns no further.
  if (glm::length(glm::cross(camera.direction, camera.up)) < 1e-3) camera.up = to.camera.up;
  if (glm::length(glm::cross(camera.direction, camera.up)) < 1e-3) return to.camera;
  return camera;
}

}  // namespace server
