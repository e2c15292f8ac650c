#include "server/bake/random_views.h"

#include <algorithm>
#include <functional>
#include <optional>

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

std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options) {
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
