#include "server/views/random_views.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <glm/gtc/constants.hpp>
#include <optional>

#include "base/check.h"
#include "base/file.h"
#include "repository/sampling/cube_face.h"
#include "server/views/level.h"

namespace server {
namespace {

constexpr std::size_t kMaxTries = 1000;      // for each view: a model that fills its box leaves little room
constexpr double kMinTargetDistance = 1e-3;  // in diagonals of the model's box: nearer ones give no direction
constexpr double kMinUpSine = 0.05;          // looking within 3° of up leaves the picture's rotation open

struct EyeAndDirection {
  glm::dvec3 eye;  ///< world
  glm::dvec3 direction;
};

// Calls `draw` until enough of what it draws can be viewed from.
std::vector<base::ViewCamera> drawViews(const base::Scene& scene, const Enclosure& enclosure,
                                        const RandomViews& options,
                                        const std::function<std::optional<EyeAndDirection>()>& draw) {
  std::vector<base::ViewCamera> views;
  for (std::size_t tries = 0; views.size() < options.count && tries < kMaxTries * options.count; ++tries) {
    const auto drawn = draw();
    if (!drawn) continue;
    base::ViewCamera view;
    view.position = drawn->eye;
    view.direction = drawn->direction;
    view.up = scene.up;
    if (glm::length(glm::cross(view.direction, view.up)) < kMinUpSine) continue;
    if (enclosure.isBehind(glm::vec3(view.position - scene.origin))) continue;
    view.width = options.width;
    view.height = options.height;
    views.push_back(view);
  }
  return views;
}

}  // namespace

std::vector<base::ViewCamera> indoorViews(const base::Scene& scene, const Indoors& indoors, std::size_t count,
                                          std::uint32_t seed) {
  constexpr double kLowest = -0.57, kHighest = 0.34;  // sines of 35 and 20 degrees
  UnitRandom random(seed);
  const glm::dvec3 up = glm::normalize(scene.up);
  const glm::dvec3 side = levelDirection(up);
  const glm::dvec3 across = glm::cross(up, side);
  const base::Aabb& box = indoors.box();
  std::vector<base::ViewCamera> views;
  for (std::size_t tries = 0; views.size() < count && tries < kMaxTries * count; ++tries) {
    glm::vec3 share;
    for (int axis = 0; axis < 3; ++axis) share[axis] = static_cast<float>(random());
    const glm::vec3 eye = box.min + share * box.size();
    const double around = 2.0 * glm::pi<double>() * random();
    const double rise = kLowest + (kHighest - kLowest) * random();
    if (!indoors.contains(eye)) continue;
    base::ViewCamera view;
    view.position = scene.origin + glm::dvec3(eye);
    view.direction = std::sqrt(1.0 - rise * rise) * (std::cos(around) * side + std::sin(around) * across) + rise * up;
    view.up = scene.up;
    views.push_back(view);
  }
  return views;
}

base::Result<ViewerPlaces> ViewerPlaces::ofScene(const std::string& directory, const glm::dvec3& origin) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(directory));
  LUMIGRID_ASSIGN_OR_RETURN(const auto files, repository::loadSceneAccess(directory, base::hierarchyDigest(scene)));
  const std::string path = repository::accessFileOf(directory);
  if (files.empty())
    return base::Error{base::ErrorCode::kNotFound,
                       path + ": there is no such file; `lumigrid serve` counts there what viewers are sent"};
  if (std::all_of(files.begin(), files.end(), [](const auto& file) { return file.counts.faces.empty(); }))
    return base::Error{base::ErrorCode::kInvalidInput, path + ": no image was sent to any viewer yet"};
  return ViewerPlaces(files, glm::vec3(scene.origin - origin));
}

ViewerPlaces::ViewerPlaces(const std::vector<repository::AccessFile>& files, const glm::vec3& offset) {
  std::uint64_t sent = 0;
  for (const repository::AccessFile& file : files) {
    const repository::Grid& grid = file.identity.grid;
    for (const auto& [key, count] : file.counts.faces) {
      sent += count;
      faces_.push_back({grid.point(key.x, key.y, key.z) + offset, grid.spacing, key.d, sent});
    }
  }
  LUMIGRID_CHECK(!faces_.empty());
}

ViewerPlaces::Pose ViewerPlaces::draw(UnitRandom& random) const {
  const auto number = static_cast<std::uint64_t>(random() * static_cast<double>(faces_.back().sent_until));
  const auto face = std::upper_bound(faces_.begin(), faces_.end() - 1, number,
                                     [](std::uint64_t n, const SentFace& f) { return n < f.sent_until; });
  const auto symmetric = [&](double half) { return static_cast<float>((2.0 * random() - 1.0) * half); };
  Pose pose{face->point, repository::faceDirection(face->d)};
  for (int axis = 0; axis < 3; ++axis) pose.position[axis] += symmetric(0.5) * face->spacing;
  const glm::vec3 up = repository::faceUp(face->d);
  const glm::vec3 right = glm::cross(pose.direction, up);
  const float u = symmetric(1.0);
  const float v = symmetric(1.0);
  pose.direction = glm::normalize(pose.direction + u * right + v * up);
  return pose;
}

std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options) {
  if (options.indoors != nullptr) {
    auto views = indoorViews(scene, *options.indoors, options.count, options.seed);
    for (base::ViewCamera& view : views) view.width = options.width, view.height = options.height;
    return views;
  }
  UnitRandom random(options.seed);
  const auto within = [&](const glm::dvec3& low, const glm::dvec3& high) {
    const double x = random();
    const double y = random();
    return low + (high - low) * glm::dvec3(x, y, random());
  };
  const glm::dvec3 size = scene.box_max - scene.box_min;
  const glm::dvec3 grown(options.margin * std::max({size.x, size.y, size.z}));
  return drawViews(scene, enclosure, options, [&]() -> std::optional<EyeAndDirection> {
    const glm::dvec3 eye = within(scene.box_min - grown, scene.box_max + grown);
    const glm::dvec3 target = within(scene.box_min + 0.25 * size, scene.box_max - 0.25 * size);
    if (glm::length(target - eye) < kMinTargetDistance * glm::length(size)) return std::nullopt;
    return EyeAndDirection{eye, glm::normalize(target - eye)};
  });
}

std::vector<base::ViewCamera> randomViewerViews(const base::Scene& scene, const Enclosure& enclosure,
                                                const ViewerPlaces& places, const RandomViews& options) {
  UnitRandom random(options.seed);
  return drawViews(scene, enclosure, options, [&]() -> std::optional<EyeAndDirection> {
    const ViewerPlaces::Pose pose = places.draw(random);
    return EyeAndDirection{scene.origin + glm::dvec3(pose.position), glm::dvec3(pose.direction)};
  });
}

}  // namespace server
