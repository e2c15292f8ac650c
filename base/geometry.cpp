#include "base/geometry.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace base {
namespace {

// float sums may round down by a few units in the last place; a bound must not.
float roundUp(float radius) {
  return radius * (1.0F + 4.0e-6F);
}

void grow(Sphere& sphere, const glm::vec3& p, float r) {
  const float distance = glm::length(p - sphere.center);
  if (distance + r <= sphere.radius) return;
  if (distance + sphere.radius <= r) {
    sphere = {p, r};
    return;
  }
  const float radius = 0.5F * (distance + r + sphere.radius);
  if (distance > 0.0F) sphere.center += (p - sphere.center) * ((radius - sphere.radius) / distance);
  sphere.radius = radius;
}

float squaredDistance(const glm::vec3& a, const glm::vec3& b) {
  const glm::vec3 d = a - b;
  return glm::dot(d, d);
}

// A quick test without a square root: false only where grow() would not change the sphere.
bool mayStickOut(const Sphere& sphere, const glm::vec3& p) {
  return squaredDistance(p, sphere.center) > sphere.radius * sphere.radius * (1.0F - 1.0e-5F);
}

// The index of the farthest point, the first of several.
std::size_t farthestFrom(const glm::vec3& from, std::span<const glm::vec3> points) {
  // Four maxima are kept side by side, since a single one would have to wait for the previous comparison.
  std::array<float, 4> most{-1.0F, -1.0F, -1.0F, -1.0F};
  std::size_t i = 0;
  for (; i + 4 <= points.size(); i += 4)
    for (std::size_t k = 0; k < 4; ++k) most[k] = std::max(most[k], squaredDistance(points[i + k], from));
  for (; i < points.size(); ++i) most[0] = std::max(most[0], squaredDistance(points[i], from));
  const float farthest = std::max({most[0], most[1], most[2], most[3]});
  for (i = 0; i + 1 < points.size() && squaredDistance(points[i], from) != farthest;) ++i;
  return i;
}

}  // namespace

Sphere boundingSphere(std::span<const glm::vec3> points) {
  if (points.empty()) return {};
  // Ritter 1990 starts with two points far apart; then every point outside grows the sphere.
  const glm::vec3 a = points[farthestFrom(points[0], points)];
  const glm::vec3 b = points[farthestFrom(a, points)];
  Sphere sphere{0.5F * (a + b), 0.5F * glm::length(a - b)};
  for (const glm::vec3& p : points)
    if (mayStickOut(sphere, p)) grow(sphere, p, 0.0F);
  // The centre moved while the sphere grew, so a last pass makes the radius a bound again.
  sphere.radius = std::max(sphere.radius, glm::length(points[farthestFrom(sphere.center, points)] - sphere.center));
  sphere.radius = roundUp(sphere.radius);
  return sphere;
}

Sphere boundingSphere(std::span<const Sphere> spheres) {
  if (spheres.empty()) return {};
  Sphere sphere = *std::max_element(spheres.begin(), spheres.end(),
                                    [](const Sphere& a, const Sphere& b) { return a.radius < b.radius; });
  for (const Sphere& s : spheres) grow(sphere, s.center, s.radius);
  for (const Sphere& s : spheres)
    sphere.radius = std::max(sphere.radius, glm::length(s.center - sphere.center) + s.radius);
  sphere.radius = roundUp(sphere.radius);
  return sphere;
}

NormalCone boundingCone(std::span<const glm::vec3> unit_normals) {
  glm::vec3 sum(0.0F);
  for (const glm::vec3& n : unit_normals) sum += n;
  const float length = glm::length(sum);
  if (length < 1e-6F) return {};
  NormalCone cone{sum / length, 1.0F};
  for (const glm::vec3& n : unit_normals)
    if (glm::dot(n, n) > 0.0F) cone.cos_angle = std::min(cone.cos_angle, glm::dot(cone.axis, n));
  cone.cos_angle = std::max(-1.0F, cone.cos_angle - 1e-5F);
  return cone;
}

bool facesAway(const NormalCone& cone, const Sphere& bounds, const glm::vec3& eye) {
  if (cone.cos_angle <= 0.0F) return false;
  const glm::vec3 to_center = bounds.center - eye;
  const float distance = glm::length(to_center);
  if (distance <= bounds.radius) return false;
  // A view ray deviates from to_center by at most asin(r/d), a normal from the axis by at most the cone's angle; the
  // surface faces away where the angle between ray and normal stays under 90 degrees.
  const float cos_between = glm::dot(to_center, cone.axis) / distance;
  const float between = std::acos(std::clamp(cos_between, -1.0F, 1.0F));
  const float spread =
      std::asin(std::min(1.0F, bounds.radius / distance)) + std::acos(std::clamp(cone.cos_angle, -1.0F, 1.0F));
  return between + spread < 1.5707F;
}

Frustum::Frustum(const glm::mat4& m) {
  auto row = [&](int i) { return glm::vec4(m[0][i], m[1][i], m[2][i], m[3][i]); };
  planes = {row(3) + row(0), row(3) - row(0), row(3) + row(1), row(3) - row(1), row(3) + row(2), row(3) - row(2)};
  for (glm::vec4& p : planes) {
    const float length = glm::length(glm::vec3(p));
    if (length > 0.0F) p /= length;
  }
}

bool Frustum::mayOverlap(const Aabb& box) const {
  for (const glm::vec4& p : planes) {
    const glm::vec3 corner(p.x >= 0 ? box.max.x : box.min.x, p.y >= 0 ? box.max.y : box.min.y,
                           p.z >= 0 ? box.max.z : box.min.z);
    if (glm::dot(glm::vec3(p), corner) + p.w < 0.0F) return false;
  }
  return true;
}

bool Frustum::mayOverlap(const Sphere& sphere) const {
  return std::all_of(planes.begin(), planes.end(),
                     [&](const glm::vec4& p) { return glm::dot(glm::vec3(p), sphere.center) + p.w >= -sphere.radius; });
}

glm::dvec3 closestWeightsOnTriangle(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b,
                                    const glm::dvec3& c) {
  const auto on = [](double share_b, double share_c) { return glm::dvec3(1.0 - share_b - share_c, share_b, share_c); };
  const glm::dvec3 ab = b - a;
  const glm::dvec3 ac = c - a;
  const glm::dvec3 ap = p - a;
  const double d1 = glm::dot(ab, ap);
  const double d2 = glm::dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return on(0, 0);
  const glm::dvec3 bp = p - b;
  const double d3 = glm::dot(ab, bp);
  const double d4 = glm::dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return on(1, 0);
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return on(d1 - d3 > 0 ? d1 / (d1 - d3) : 0, 0);
  const glm::dvec3 cp = p - c;
  const double d5 = glm::dot(ab, cp);
  const double d6 = glm::dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return on(0, 1);
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return on(0, d2 - d6 > 0 ? d2 / (d2 - d6) : 0);
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && (d4 - d3) >= 0 && (d5 - d6) >= 0) {
    const double sum = (d4 - d3) + (d5 - d6);
    const double share = sum > 0 ? (d4 - d3) / sum : 0;
    return on(1 - share, share);
  }
  const double denominator = va + vb + vc;
  if (denominator == 0) return on(0, 0);
  return on(vb / denominator, vc / denominator);
}

glm::dvec3 closestPointOnTriangle(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  const glm::dvec3 weight = closestWeightsOnTriangle(p, a, b, c);
  // The sum starts from corner a, so that it is exact at the corners.
  return weight.y == 1.0 ? b : weight.z == 1.0 ? c : a + (b - a) * weight.y + (c - a) * weight.z;
}

glm::dvec3 northDirection(const glm::dvec3& up, double degrees) {
  const glm::dvec3 above = glm::normalize(up);
  // East of the reference: +x made horizontal, and +y where +x points up or down.
  const glm::dvec3 axis = std::abs(above.x) < 0.9 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 east = glm::normalize(axis - glm::dot(axis, above) * above);
  const double turn = glm::radians(degrees);
  return std::cos(turn) * glm::cross(above, east) + std::sin(turn) * east;
}

}  // namespace base
