#include "lod/build/qsplat/splat.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

namespace lod::build::qsplat {
namespace {

double reach(const glm::dvec3& center, const base::Sphere& sphere) {
  return glm::length(glm::dvec3(sphere.center) - center) + static_cast<double>(sphere.radius);
}

// How far a sphere around `center` must reach, and the sphere that asks for it.
std::pair<double, const base::Sphere*> farthest(const glm::dvec3& center, std::span<const base::Sphere> spheres) {
  std::pair<double, const base::Sphere*> most{-1.0, nullptr};
  for (const base::Sphere& sphere : spheres)
    if (const double r = reach(center, sphere); r > most.first) most = {r, &sphere};
  return most;
}

// Centre of the smallest sphere around two, neither of which holds the other.
glm::dvec3 betweenTwo(const base::Sphere& a, const base::Sphere& b) {
  const glm::dvec3 along = glm::dvec3(b.center) - glm::dvec3(a.center);
  const double distance = glm::length(along);
  const double apart = distance + static_cast<double>(b.radius) - static_cast<double>(a.radius);
  return distance > 0.0 ? glm::dvec3(a.center) + along * std::clamp(0.5 * apart / distance, 0.0, 1.0)
                        : glm::dvec3(a.center);
}

glm::dvec3 bestCenter(std::span<const base::Sphere> spheres) {
  // Two of them often decide. Otherwise the widest pair is where to begin.
  std::pair<double, glm::dvec3> best{-1.0, glm::dvec3(0.0)};
  for (std::size_t i = 0; i < spheres.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const glm::dvec3 center = betweenTwo(spheres[i], spheres[j]);
      const double radius = std::max(reach(center, spheres[i]), reach(center, spheres[j]));
      if (radius > best.first) best = {radius, center};
    }
  glm::dvec3 center = best.second;
  auto [radius, sphere] = farthest(center, spheres);
  if (radius <= best.first * (1.0 + 1e-9)) return center;

  // Towards the farthest by what it is farther than the lower bound, less and less (Badoiu and Clarkson 2003).
  glm::dvec3 least_center = center;
  double least = radius;
  double step = 0.5 * (radius - best.first);
  for (int i = 0; i < 12; ++i) {
    const glm::dvec3 towards = glm::dvec3(sphere->center) - center;
    const double length = glm::length(towards);
    if (!(length > 0.0)) break;
    center += towards * std::min(1.0, step / length);
    std::tie(radius, sphere) = farthest(center, spheres);
    if (radius < least) {
      least = radius;
      least_center = center;
    } else {
      step *= 0.6;
    }
  }
  return least_center;
}

// Cosine of the sum of two angles, neither above a right angle; -1 where the sum is.
float cosineOfSum(float cosine_a, float cosine_b) {
  if (cosine_a <= 0.0F || cosine_b <= 0.0F) return -1.0F;
  const float sines =
      std::sqrt(std::max(0.0F, 1.0F - cosine_a * cosine_a)) * std::sqrt(std::max(0.0F, 1.0F - cosine_b * cosine_b));
  return cosine_a * cosine_b - sines;
}

}  // namespace

base::Sphere enclosingSphere(std::span<const base::Sphere> spheres) {
  // One that holds all the others needs no other.
  const auto largest = std::max_element(spheres.begin(), spheres.end(),
                                        [](const auto& a, const auto& b) { return a.radius < b.radius; });
  if (std::all_of(spheres.begin(), spheres.end(),
                  [&](const base::Sphere& sphere) { return lod::qsplat::encloses(*largest, sphere); }))
    return *largest;
  base::Sphere out{glm::vec3(bestCenter(spheres)), 0.0F};
  const double radius = farthest(glm::dvec3(out.center), spheres).first;
  out.radius = static_cast<float>(radius);
  if (static_cast<double>(out.radius) < radius)
    out.radius = std::nextafter(out.radius, std::numeric_limits<float>::max());
  return out;
}

Splat parentOf(std::span<const Splat* const> children) {
  std::array<base::Sphere, lod::qsplat::kMostChildren> spheres;
  Splat out;
  for (std::size_t i = 0; i < children.size(); ++i) {
    spheres[i] = children[i]->sphere;
    out.normal += children[i]->normal;
    out.color += children[i]->color;
    out.weight += children[i]->weight;
  }
  out.sphere = enclosingSphere(std::span(spheres).first(children.size()));
  out.direction = lod::qsplat::encodeNormal(out.normal);
  return out;
}

float leastCosine(const glm::vec3& axis, const Splat& leaf) {
  return cosineOfSum(std::min(1.0F, glm::dot(axis, lod::qsplat::normalTable()[leaf.direction])), leaf.least_cosine);
}

}  // namespace lod::build::qsplat
