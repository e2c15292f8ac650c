#include "server/bake/random_views.h"

#include <algorithm>
#include <random>

namespace server {

std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options) {
  std::mt19937 random(options.seed);
  // Not std::uniform_real_distribution, which is another in every library.
  const auto unit = [&] { return static_cast<double>(random()) / 4294967296.0; };
  const auto within = [&](const glm::dvec3& low, const glm::dvec3& high) {
    const double x = unit();
    const double y = unit();
    return low + (high - low) * glm::dvec3(x, y, unit());
  };
  const glm::dvec3 size = scene.box_max - scene.box_min;
  const glm::dvec3 grown(options.margin * std::max({size.x, size.y, size.z}));
  constexpr std::size_t kTries = 1000;  // for a view; a model that fills its box leaves little room
  std::vector<base::ViewCamera> views;
  for (std::size_t tries = 0; views.size() < options.count && tries < kTries * options.count; ++tries) {
    base::ViewCamera view;
    view.position = within(scene.box_min - grown, scene.box_max + grown);
    const glm::dvec3 target = within(scene.box_min + 0.25 * size, scene.box_max - 0.25 * size);
    if (glm::length(target - view.position) < 1e-3 * glm::length(size)) continue;
    view.direction = glm::normalize(target - view.position);
    view.up = scene.up;
    if (glm::length(glm::cross(view.direction, view.up)) < 0.05) continue;
    if (enclosure.isBehind(glm::vec3(view.position - scene.origin))) continue;
    view.width = options.width;
    view.height = options.height;
    views.push_back(view);
  }
  return views;
}

}  // namespace server
