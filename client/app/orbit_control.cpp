#include "client/app/orbit_control.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "base/geometry.h"

namespace client {
namespace {

/// The distance's factor for one wheel step. A choice: three steps halve the distance.
constexpr double kZoomPerStep = 0.8;
/// Smallest distance to the target of zooming, in box diagonals: far below anything a scan resolves, far above the
/// rounding of doubles.
constexpr double kMinZoomDistance = 1e-7;
/// Largest distance to the target, in box diagonals. A choice: the model has some ten pixels then.
constexpr double kMaxZoomDistance = 100.0;
/// The view direction stays this far from straight up and down (radians), where "up" would be undefined.
constexpr double kPoleMargin = 0.01;
/// Angle by which the first view looks down (radians), a choice: 20 degrees.
constexpr double kFirstElevation = 0.35;
// The share of the picture that the framed model fills, so that titles and tools hide little of it.
constexpr double kFramed = 0.9;

/// Length below which a direction counts as zero.
constexpr double kTiny = 1e-12;

/// Returns any unit vector perpendicular to a unit vector.
glm::dvec3 anyPerpendicular(const glm::dvec3& v) {
  const glm::dvec3 other = std::abs(v.x) < 0.9 ? glm::dvec3(1.0, 0.0, 0.0) : glm::dvec3(0.0, 1.0, 0.0);
  return glm::normalize(glm::cross(v, other));
}

// Halves the scene's diagonal down to far less than a pixel, from as near as the view can be.
constexpr int kCentringSteps = 40;

/// Returns a vector turned about a unit axis, by an angle in radians.
glm::dvec3 turned(const glm::dvec3& v, const glm::dvec3& axis, double angle) {
  const glm::dvec3 along = glm::dot(axis, v) * axis;
  return along + std::cos(angle) * (v - along) + std::sin(angle) * glm::cross(axis, v);
}

}  // namespace

void OrbitControl::frameScene(const protocol::Welcome& scene) {
  up_ = glm::normalize(glm::dvec3(scene.up));
  origin_ = scene.origin;
  box_min_ = origin_ + glm::dvec3(scene.box_min);
  box_max_ = origin_ + glm::dvec3(scene.box_max);
  size_ = std::max(glm::length(box_max_ - box_min_), 1e-12);
  hull_ = scene.hull;
  if (hull_.empty())
    for (int corner = 0; corner < 8; ++corner) hull_.push_back(base::Aabb{scene.box_min, scene.box_max}.corner(corner));

  const glm::dvec3 from = turned(anyPerpendicular(up_), up_, 0.6);
  camera_.direction = scene.start_direction != glm::vec3(0.0F)
                          ? awayFromPoles(glm::normalize(glm::dvec3(scene.start_direction)))
                          : -glm::normalize(std::cos(kFirstElevation) * from + std::sin(kFirstElevation) * up_);
  camera_.up = up_;
  first_ = framingViewpoint();
  setViewpoint(first_);
}

Viewpoint OrbitControl::framingViewpoint() const {
  // Let a point be at (x, z) across and ahead of the origin, and the eye at (c, -d). It is within the sides of the
  // picture, less a margin, where |x - c| <= t (z + d), so that x / t - z - d <= c / t <= x / t + z + d. With d as
  // small as it can be the greatest left side of all points meets the least right side. The depth is a third
  // coordinate.
  const double tan_above = kFramed * std::tan(0.5 * camera_.fov_y);
  const glm::dvec3 tans(tan_above * camera_.width / camera_.height, tan_above, 1.0);
  const glm::dmat3 world_from_view(right(), upInView(), camera_.direction);
  const double slope = orthographic_ ? 0.0 : 1.0;  // in an orthographic picture depths do not matter
  std::vector<glm::dvec3> points;
  glm::dvec3 most(-1e300), least(1e300);
  for (const glm::vec3& point : hull_) {
    const glm::dvec3 at = glm::dvec3(point) * world_from_view;  // times the transposed rotation
    points.push_back(at);
    const glm::dvec3 slack(slope * at.z, slope * at.z, 0.0);
    most = glm::max(most, at / tans - slack);
    least = glm::min(least, at / tans + slack);
  }
  const glm::dvec3 half = 0.5 * (most - least);
  glm::dvec3 middle = 0.5 * (most + least);
  const double distance = std::max(std::max(half.x, half.y) + slope * middle.z, 1e-3 * size_);

  // From there both outermost points of each axis are to be equally far from the middle, also where there is room to
  // spare.
  for (int axis = 0; axis < 2; ++axis) {
    double low = middle[axis] * tans[axis] - size_, high = low + 2.0 * size_;
    for (int step = 0; step < kCentringSteps; ++step) {
      middle[axis] = 0.5 * (low + high);
      double left = 1e300, right = -1e300;
      for (const glm::dvec3& at : points) {
        const double depth = orthographic_ ? 1.0 : std::max(at.z - middle.z + distance, 1e-9 * size_);
        const double shown = (at[axis] - middle[axis]) / depth;
        left = std::min(left, shown);
        right = std::max(right, shown);
      }
      (left + right > 0.0 ? low : high) = middle[axis];
    }
  }
  const glm::dvec3 pivot = origin_ + world_from_view * middle;
  return {pivot - distance * camera_.direction, camera_.direction, distance};
}

Viewpoint OrbitControl::viewpointCentredOn(const glm::dvec3& world) const {
  const double distance = std::max(orthographic_ ? depthOf(pivot_) : depthOf(world), kMinZoomDistance * size_);
  return {world - distance * camera_.direction, camera_.direction, distance};
}

Viewpoint OrbitControl::viewpoint() const {
  return {camera_.position, camera_.direction, std::max(depthOf(pivot_), kMinZoomDistance * size_)};
}

void OrbitControl::setViewpoint(const Viewpoint& place) {
  camera_.direction = awayFromPoles(glm::normalize(place.direction));
  camera_.position = place.position;
  pivot_ = place.position + place.distance * camera_.direction;
}

Viewpoint OrbitControl::between(const Viewpoint& from, const Viewpoint& to, double share) const {
  if (share <= 0.0) return from;
  if (share >= 1.0) return to;

  // Interpolate heading and elevation separately, so that the horizon stays level and no pole is crossed.
  const glm::dvec3 east = anyPerpendicular(up_);
  const glm::dvec3 north = glm::cross(up_, east);
  const auto heading = [&](const glm::dvec3& d) { return std::atan2(glm::dot(d, north), glm::dot(d, east)); };
  const auto elevation = [&](const glm::dvec3& d) { return std::asin(std::clamp(glm::dot(d, up_), -1.0, 1.0)); };
  const double turn = std::remainder(heading(to.direction) - heading(from.direction), glm::two_pi<double>());
  const double h = heading(from.direction) + share * turn;
  const double e = glm::mix(elevation(from.direction), elevation(to.direction), share);

  Viewpoint place;
  place.direction = std::cos(e) * (std::cos(h) * east + std::sin(h) * north) + std::sin(e) * up_;
  place.distance = from.distance * std::pow(to.distance / from.distance, share);
  const glm::dvec3 pivot =
      glm::mix(from.position + from.distance * from.direction, to.position + to.distance * to.direction, share);
  place.position = pivot - place.distance * place.direction;
  return place;
}

glm::dvec3 OrbitControl::awayFromPoles(const glm::dvec3& direction) const {
  const double along = std::clamp(glm::dot(direction, up_), -1.0, 1.0);
  const double angle = std::acos(along);
  const double allowed = std::clamp(angle, kPoleMargin, glm::pi<double>() - kPoleMargin);
  if (allowed == angle) return direction;
  const glm::dvec3 level = direction - along * up_;
  const double length = glm::length(level);
  const glm::dvec3 side = length > kTiny ? level / length : anyPerpendicular(up_);
  return std::cos(allowed) * up_ + std::sin(allowed) * side;
}

void OrbitControl::setViewport(int width, int height) {
  camera_.width = std::max(width, 1);
  camera_.height = std::max(height, 1);
}

glm::dvec3 OrbitControl::right() const {
  return glm::normalize(glm::cross(camera_.direction, up_));
}
glm::dvec3 OrbitControl::upInView() const {
  return glm::cross(right(), camera_.direction);
}

void OrbitControl::orbit(double dx_px, double dy_px) {
  const double angle_per_px = glm::pi<double>() / static_cast<double>(camera_.height);
  const double yaw = -dx_px * angle_per_px;

  // Limit the pitch so that the angle between direction and up stays between the margins.
  const double to_up = std::acos(std::clamp(glm::dot(camera_.direction, up_), -1.0, 1.0));
  const double wanted = to_up + dy_px * angle_per_px;
  const double pitch = to_up - std::clamp(wanted, kPoleMargin, glm::pi<double>() - kPoleMargin);

  // Turn the arm from the pivot and the direction alike.
  const glm::dvec3 axis = right();
  const auto turn = [&](const glm::dvec3& v) { return turned(turned(v, axis, pitch), up_, yaw); };
  camera_.position = pivot_ + turn(camera_.position - pivot_);
  camera_.direction = glm::normalize(turn(camera_.direction));
}

double OrbitControl::depthOf(const glm::dvec3& world) const {
  return glm::dot(world - camera_.position, camera_.direction);
}

/// Returns the world units that a pixel covers at distance 1.
double OrbitControl::pixelScale() const {
  return 2.0 * std::tan(0.5 * camera_.fov_y) / static_cast<double>(camera_.height);
}

double OrbitControl::orthoHeight() const {
  return orthographic_ ? pixelScale() * camera_.height * viewpoint().distance : 0.0;
}

glm::dvec3 OrbitControl::pointAt(double x, double y, double depth) const {
  const double scale = pixelScale() * (orthographic_ ? viewpoint().distance : depth);
  const double side = (x - 0.5 * camera_.width) * scale;
  const double height = (0.5 * camera_.height - y) * scale;
  return camera_.position + depth * camera_.direction + side * right() + height * upInView();
}

ScreenPoint OrbitControl::project(const glm::dvec3& world) const {
  ScreenPoint point;
  point.depth = depthOf(world);
  const double pixel = pixelScale() * (orthographic_ ? viewpoint().distance : point.depth);
  if (pixel <= 0.0) return point;
  const glm::dvec3 from_eye = world - camera_.position;
  point.x = 0.5 * camera_.width + glm::dot(from_eye, right()) / pixel;
  point.y = 0.5 * camera_.height - glm::dot(from_eye, upInView()) / pixel;
  return point;
}

Ray OrbitControl::rayAt(double x, double y) const {
  if (!orthographic_) return {camera_.position, glm::normalize(pointAt(x, y, 1.0) - camera_.position)};
  // Begin behind the farther end of the box and so outside of it, wherever the camera stands.
  const double behind = glm::length(boxCenter() - camera_.position) + size_;
  return {pointAt(x, y, -behind), camera_.direction};
}

double OrbitControl::pixelSizeAt(const glm::dvec3& world) const {
  return pixelScale() * (orthographic_ ? viewpoint().distance : std::max(depthOf(world), 0.0));
}

void OrbitControl::move(const glm::dvec3& offset) {
  camera_.position += offset;
  pivot_ += offset;
}

void OrbitControl::grab(double x, double y, const std::optional<glm::dvec3>& surface) {
  const double depth = depthOf(surface.value_or(pivot_));
  grabbed_ = pointAt(x, y, std::max(depth, kMinZoomDistance * size_));
}

void OrbitControl::dragTo(double x, double y) {
  move(grabbed_ - pointAt(x, y, depthOf(grabbed_)));
}

void OrbitControl::zoom(double steps, double x, double y, const std::optional<glm::dvec3>& surface) {
  const double pivot_depth = std::max(depthOf(pivot_), kMinZoomDistance * size_);
  // In an orthographic picture all depths look alike; magnifying keeps the point of the pivot's plane that is shown at
  // (x, y).
  const glm::dvec3 shown = pointAt(x, y, pivot_depth);
  const glm::dvec3 target = orthographic_ ? shown : surface.value_or(shown);

  // Move towards the target on a straight line, so that its place on the screen stays. The pivot keeps its place on the
  // screen, too, and comes nearer alike. Where the surface is known, the pivot goes to the surface's depth, so that the
  // next turn goes around the surface that is looked at and not through it.
  const double distance = glm::length(target - camera_.position);
  if (distance <= 0.0) return;
  const double wanted =
      std::clamp(distance * std::pow(kZoomPerStep, steps), std::min(distance, kMinZoomDistance * size_),
                 std::max(distance, kMaxZoomDistance * size_));
  const double factor = wanted / distance;
  const glm::dvec3 arm = pivot_ - camera_.position;
  camera_.position = target - factor * (target - camera_.position);
  const double arm_depth = glm::dot(factor * arm, camera_.direction);
  const double surface_depth = glm::dot(target - camera_.position, camera_.direction);
  const bool on_surface = surface && !orthographic_ && arm_depth > 0.0 && surface_depth > 0.0;
  pivot_ = camera_.position + (on_surface ? surface_depth / arm_depth : 1.0) * factor * arm;
}

void OrbitControl::fly(const glm::dvec3& distance) {
  const double unit = std::max(glm::length(pivot_ - camera_.position), kMinZoomDistance * size_);
  if (orthographic_) {
    move(unit * (distance.x * right() + distance.y * upInView()));
    zoom(distance.z / -std::log(kZoomPerStep), 0.5 * camera_.width, 0.5 * camera_.height, std::nullopt);
    return;
  }
  move(unit * (distance.x * right() + distance.y * upInView() + distance.z * camera_.direction));
}

}  // namespace client
