#include "lod/qsplat/builder/splat.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace lod::qsplat::builder {
namespace {

// Up to four spheres, coordinate by coordinate, so that SIMD instructions handle all four at once. Unused places repeat
// the first sphere.
struct Spheres {
  static constexpr std::size_t kRoom = kMaxChildren;
  std::array<double, kRoom> x, y, z, radius;

  explicit Spheres(std::span<const base::Sphere> spheres) {
    for (std::size_t i = 0; i < kRoom; ++i) {
      const base::Sphere& sphere = spheres[i < spheres.size() ? i : 0];
      x[i] = static_cast<double>(sphere.center.x);
      y[i] = static_cast<double>(sphere.center.y);
      z[i] = static_cast<double>(sphere.center.z);
      radius[i] = static_cast<double>(sphere.radius);
    }
  }
  glm::dvec3 center(std::size_t i) const { return {x[i], y[i], z[i]}; }

  // The sphere that a sphere around `from` must reach farthest to enclose, that reach, and the distance of its centre.
  struct FarthestSphere {
    std::size_t sphere = 0;
    double reach = 0.0;
    double distance = 0.0;
  };
  FarthestSphere farthest(const glm::dvec3& from) const {
    std::array<double, kRoom> distance;
    for (std::size_t i = 0; i < kRoom; ++i) {
      const double dx = x[i] - from.x, dy = y[i] - from.y, dz = z[i] - from.z;
      distance[i] = std::sqrt(dx * dx + dy * dy + dz * dz);
    }
    FarthestSphere out{0, distance[0] + radius[0], distance[0]};
    for (std::size_t i = 1; i < kRoom; ++i)
      if (const double reach = distance[i] + radius[i]; reach > out.reach) out = {i, reach, distance[i]};
    return out;
  }
  // The centre of the smallest sphere around two, neither of which encloses the other.
  glm::dvec3 between(std::size_t a, std::size_t b) const {
    const glm::dvec3 along = center(b) - center(a);
    const double distance = glm::length(along);
    const double apart = distance + radius[b] - radius[a];
    return distance > 0.0 ? center(a) + along * std::clamp(0.5 * apart / distance, 0.0, 1.0) : center(a);
  }
};

glm::dvec3 bestCenter(const Spheres& spheres, std::size_t count) {
  // Often two spheres determine the smallest one. Otherwise the search starts from the widest pair.
  std::pair<double, glm::dvec3> best{-1.0, glm::dvec3(0.0)};
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const glm::dvec3 center = spheres.between(i, j);
      const auto reach = [&](std::size_t k) { return glm::length(spheres.center(k) - center) + spheres.radius[k]; };
      const double radius = std::max(reach(i), reach(j));
      if (radius > best.first) best = {radius, center};
    }
  glm::dvec3 center = best.second;
  Spheres::FarthestSphere most = spheres.farthest(center);
  if (most.reach <= best.first * (1.0 + 1e-9)) return center;

  // The centre moves towards the farthest sphere, by shorter and shorter steps (Bădoiu and Clarkson 2003).
  glm::dvec3 least_center = center;
  double least = most.reach;
  double step = 0.5 * (most.reach - best.first);
  for (int i = 0; i < 12 && most.distance > 0.0; ++i) {
    center += (spheres.center(most.sphere) - center) * std::min(1.0, step / most.distance);
    most = spheres.farthest(center);
    if (most.reach < least) {
      least = most.reach;
      least_center = center;
    } else {
      step *= 0.6;
    }
  }
  return least_center;
}

}  // namespace

base::Sphere enclosingSphere(std::span<const base::Sphere> spheres) {
  // The largest sphere may enclose all others.
  const auto largest = std::max_element(spheres.begin(), spheres.end(),
                                        [](const auto& a, const auto& b) { return a.radius < b.radius; });
  if (std::all_of(spheres.begin(), spheres.end(),
                  [&](const base::Sphere& sphere) { return encloses(*largest, sphere); }))
    return *largest;
  const Spheres all(spheres);
  base::Sphere out{glm::vec3(bestCenter(all, spheres.size())), 0.0F};
  const double radius = all.farthest(glm::dvec3(out.center)).reach;
  out.radius = static_cast<float>(radius);
  if (static_cast<double>(out.radius) < radius)
    out.radius = std::nextafter(out.radius, std::numeric_limits<float>::max());
  return out;
}

Splat parentOf(std::span<const Splat* const> children) {
  std::array<base::Sphere, kMaxChildren> spheres;
  Splat out;
  for (std::size_t i = 0; i < children.size(); ++i) {
    spheres[i] = children[i]->sphere;
    out.normal += children[i]->normal;
    out.color += children[i]->color;
    out.weight += children[i]->weight;
  }
  out.sphere = enclosingSphere(std::span(spheres).first(children.size()));
  out.direction = encodeNormal(out.normal);
  return out;
}

}  // namespace lod::qsplat::builder
