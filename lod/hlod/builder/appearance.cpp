#include "lod/hlod/builder/appearance.h"

#include <algorithm>

namespace lod::hlod::builder {
namespace {

constexpr float kInfinite = std::numeric_limits<float>::infinity();

/// The distance along the triangle over which the attribute changes by `difference`.
float reach(float difference, float rate) {
  return difference <= 0.0F ? 0.0F : rate > 0.0F ? difference / rate : kInfinite;
}

}  // namespace

AppearanceTriangle::AppearanceTriangle(const Attributes& a, const Attributes& b, const Attributes& c,
                                       const AppearanceOptions& options)
    : corners_{a, b, c}, options_(options) {
  for (std::size_t k = 0; k < 3; ++k) {
    const Attributes& from = corners_[k];
    const Attributes& to = corners_[(k + 1) % 3];
    const float length = glm::length(to.position - from.position);
    if (!(length > 0.0F)) continue;
    if (options.normals) turn_ = std::max(turn_, angleBetween(from.normal, to.normal) / length);
    if (options.colors) slope_ = std::max(slope_, glm::length(to.color - from.color) / length);
  }
}

float AppearanceTriangle::error2(const Attributes& place, float enough2) const {
  const auto& [a, b, c] = corners_;
  const glm::vec3 w = closestWeights(place.position, a.position, b.position, c.position);
  const glm::vec3 off = w.x * a.position + w.y * b.position + w.z * c.position - place.position;
  float sum = glm::dot(off, off);
  if (sum > enough2) return sum;
  if (options_.normals) {
    const glm::vec3 normal = w.x * a.normal + w.y * b.normal + w.z * c.normal;
    const float length = glm::length(normal);
    // Normals that cancel each other out are none.
    const float turn = length > 0.0F ? angleBetween(normal / length, place.normal) : 3.1415927F;
    const float along = reach(turn - options_.negligible_turn, turn_);
    sum += along * along;
  }
  if (options_.colors) {
    const glm::vec3 color = w.x * a.color + w.y * b.color + w.z * c.color;
    const float along = reach(glm::length(color - place.color) - options_.negligible_color, slope_);
    sum += along * along;
  }
  return sum;
}

}  // namespace lod::hlod::builder
