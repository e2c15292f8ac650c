#include "server/views/camera_paths.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>

#include "server/views/indoor_paths.h"
#include "server/views/level.h"
#include "server/views/random_views.h"

namespace server {
namespace {

constexpr double kRate = 60.0;  // views a second of the paths made here
constexpr double kFast = 6.0;

/// A scene as paths see it: what is up, where the ground and the middle are, and how large everything is.
struct Place {
  glm::dvec3 center, up, ahead, right;        // world; the last three are unit vectors at right angles
  double diagonal = 1.0;                      // of the box
  double height = 0.0;                        // of the box, along `up`
  double half_ahead = 0.5, half_right = 0.5;  // of its sides along the two
};

Place placeOf(const base::Scene& scene) {
  Place place;
  place.center = 0.5 * (scene.box_min + scene.box_max);
  place.up = glm::normalize(scene.up);
  place.right = levelDirection(place.up);
  place.ahead = glm::cross(place.right, place.up);
  place.diagonal = std::max(glm::length(scene.box_max - scene.box_min), 1e-9);
  const glm::dvec3 sides = scene.box_max - scene.box_min;
  const double least = 0.05 * place.diagonal;  // around a thin wall, too
  place.height = glm::dot(glm::abs(place.up), sides);
  place.half_ahead = std::max(0.5 * glm::dot(glm::abs(place.ahead), sides), least);
  place.half_right = std::max(0.5 * glm::dot(glm::abs(place.right), sides), least);
  return place;
}

base::ViewCamera lookingAt(const Place& place, const glm::dvec3& eye, const glm::dvec3& target) {
  base::ViewCamera view;
  view.position = eye;
  view.direction = glm::normalize(target - eye);
  view.up = place.up;
  return view;
}

/// The place at an angle around the model, at an elevation and a distance in diagonals.
glm::dvec3 around(const Place& place, double angle, double elevation, double distance) {
  const glm::dvec3 level = std::cos(angle) * place.ahead + std::sin(angle) * place.right;
  return place.center + distance * place.diagonal * (std::cos(elevation) * level + std::sin(elevation) * place.up);
}

constexpr double kElevation = 0.5;  // radians, 29 degrees
constexpr double kDistance = 1.0;   // diagonals; a choice: the model about fills the picture

/// Ten degrees a second around the model.
base::ViewCamera orbit(const Place& place, double t) {
  return lookingAt(place, around(place, glm::radians(10.0) * t, kElevation, kDistance), place.center);
}

/// Towards the middle of the model; the distance halves every four seconds, down to a twentieth of the diagonal.
base::ViewCamera approach(const Place& place, double t) {
  const double distance = std::max(kDistance * std::exp2(-0.25 * t), 0.05);
  return lookingAt(place, around(place, 0.6, kElevation, distance + 0.15), place.center);
}

/// Around the model just outside its box, where nothing of it can be in the way, at a third of its height, looking
/// inward and ahead; a diagonal in about twelve seconds.
base::ViewCamera walk(const Place& place, double t) {
  constexpr double kRadius = 0.45;  // diagonals: about half of the sides
  const double angle = t / (12.0 * kRadius);
  const glm::dvec3 outward =
      std::cos(angle) * place.half_ahead * place.ahead + std::sin(angle) * place.half_right * place.right;
  const glm::dvec3 onward =
      -std::sin(angle) * place.half_ahead * place.ahead + std::cos(angle) * place.half_right * place.right;
  const glm::dvec3 eye = place.center + (1.0 / 3.0 - 0.5) * place.height * place.up + 1.1 * outward;
  return lookingAt(place, eye, eye + 0.7 * glm::normalize(onward) - glm::normalize(outward));
}

/// Three seconds at one side, a second on the way to the next, which is nearer.
base::ViewCamera inspection(const Place& place, double t) {
  const double stop = std::floor(t / 4.0);
  const double way = std::clamp(t - 4.0 * stop - 3.0, 0.0, 1.0);
  const double smooth = way * way * (3.0 - 2.0 * way);
  const double at = stop + smooth;
  return lookingAt(place, around(place, 1.1 * at, kElevation, kDistance / (1.0 + 0.4 * at)), place.center);
}

/// A place anywhere around the model every two seconds.
base::ViewCamera teleport(const Place& place, UnitRandom& random) {
  const double angle = 2.0 * glm::pi<double>() * random();
  const double elevation = 0.1 + 0.9 * random();
  const double distance = 0.6 + 0.6 * random();
  return lookingAt(place, around(place, angle, elevation, distance), place.center);
}

/// A slow orbit held in a hand that trembles: half a degree, at a few hertz.
base::ViewCamera jitter(const Place& place, double t) {
  base::ViewCamera view = orbit(place, 0.2 * t);
  const double amplitude = glm::radians(0.5);
  const glm::dvec3 right = glm::normalize(glm::cross(view.direction, place.up));
  const glm::dvec3 tremble = std::sin(19.0 * t) * right + std::sin(23.0 * t + 1.0) * place.up;
  view.direction = glm::normalize(view.direction + amplitude * tremble);
  return view;
}

using Shape = base::ViewCamera (*)(const Place&, double);

struct NamedShape {
  const char* name;
  Shape shape;
  IndoorPath indoors;
};
constexpr NamedShape kShapes[] = {{"orbit", orbit, indoorOrbit},
                                  {"approach", approach, indoorApproach},
                                  {"walk", walk, indoorWalk},
                                  {"inspection", inspection, indoorInspection},
                                  {"jitter", jitter, indoorJitter}};

base::CameraPath teleports(const base::Scene& scene, const Indoors* indoors, double every_seconds,
                           const PathOptions& options) {
  base::CameraPath path;
  path.frames_per_second = 1.0 / every_seconds;
  path.jumps = true;
  const auto count = static_cast<std::size_t>(std::max(1.0, std::round(options.seconds * path.frames_per_second)));
  if (indoors != nullptr) {
    path.frames = indoorViews(scene, *indoors, count, options.seed);
    return path;
  }
  UnitRandom random(options.seed);
  const Place place = placeOf(scene);
  for (std::size_t i = 0; i < count; ++i) path.frames.push_back(teleport(place, random));
  return path;
}

std::vector<base::ViewCamera> camerasOf(const base::Scene& scene, const std::vector<IndoorEye>& eyes) {
  std::vector<base::ViewCamera> cameras;
  for (const IndoorEye& eye : eyes) {
    base::ViewCamera view;
    view.position = scene.origin + glm::dvec3(eye.position);
    view.direction = glm::normalize(glm::dvec3(eye.direction));
    view.up = glm::normalize(scene.up);
    cameras.push_back(view);
  }
  return cameras;
}

std::vector<base::ViewCamera> shapedFrames(const NamedShape& one, const base::Scene& scene, const Indoors* indoors,
                                           double speed, int count) {
  if (indoors != nullptr) return camerasOf(scene, one.indoors(*indoors, speed / kRate, count));
  std::vector<base::ViewCamera> frames;
  const Place place = placeOf(scene);
  for (int i = 0; i < count; ++i) frames.push_back(one.shape(place, speed * i / kRate));
  return frames;
}

}  // namespace

std::vector<base::ViewCamera> roomsTour(const base::Scene& scene, const Indoors& indoors, int frames) {
  return camerasOf(scene, indoorTour(indoors, frames));
}

const std::vector<std::string>& pathNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const NamedShape& one : kShapes) all.emplace_back(one.name);
    all.emplace_back("teleports");
    for (std::size_t i = 0, slow = all.size(); i < slow; ++i) all.push_back(all[i] + "-fast");
    return all;
  }();
  return names;
}

base::Result<base::CameraPath> makePath(const std::string& name, const base::Scene& scene, const PathOptions& options,
                                        const Indoors* indoors) {
  const std::string fast_end = "-fast";
  const bool fast = name.ends_with(fast_end);
  const std::string slow = fast ? name.substr(0, name.size() - fast_end.size()) : name;
  const double speed = fast ? kFast : 1.0;
  base::CameraPath path;
  if (slow == "teleports") path = teleports(scene, indoors, 2.0 / speed, options);
  for (const NamedShape& one : kShapes) {
    if (slow != one.name) continue;
    path.frames_per_second = kRate;
    const int count = std::max(1, static_cast<int>(std::lround(options.seconds * kRate)));
    path.frames = shapedFrames(one, scene, indoors, speed, count);
  }
  if (path.frames.empty()) {
    std::string all;
    for (const std::string& known : pathNames()) all += (all.empty() ? "" : ", ") + known;
    return base::Error{base::ErrorCode::kInvalidInput, "path '" + name + "': there is none; choose from " + all};
  }
  for (base::ViewCamera& view : path.frames) {
    view.width = options.width;
    view.height = options.height;
  }
  return path;
}

}  // namespace server
