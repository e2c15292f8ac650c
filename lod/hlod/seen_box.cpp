#include "lod/hlod/seen_box.h"

#include <algorithm>
#include <cmath>

namespace lod::hlod {
namespace {

/// Frusta are taken wider by this factor, so that float32 leaves nothing out at their rims.
constexpr double kRim = 1.001;

bool isFiniteVector(const glm::dvec4& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z) && std::isfinite(v.w);
}

/// Coordinates along `axis` that a frustum shows at the depth −z.
std::array<double, 2> rangeAt(const glm::dmat4& clip, int axis, double z) {
  const double w = clip[2][3] * z + clip[3][3];
  const double middle = -clip[2][axis] * z - clip[3][axis];
  return {(middle - kRim * w) / clip[axis][axis], (middle + kRim * w) / clip[axis][axis]};
}

}  // namespace

BoxCorners boxCorners(const base::Aabb& box) {
  BoxCorners corners;
  for (int i = 0; i < 8; ++i) corners[static_cast<std::size_t>(i)] = glm::dvec3(box.corner(i));
  return corners;
}

SeenSpace::SeenSpace(const TraverseRequest& request)
    : clip_(request.tile.value_or(request.camera).clip_from_eye),
      axes_(glm::transpose(glm::dmat3(glm::mat3(request.tile.value_or(request.camera).eye_from_scene)))),
      // Not the transpose: it is a rotation but for rounding, which counts far from the zero.
      scene_from_eye_(glm::inverse(glm::transpose(axes_))),
      shift_(glm::vec3(request.tile.value_or(request.camera).eye_from_scene[3])),
      pixels_at_one_(static_cast<double>(request.camera.pixelsPerUnitAtOne())) {
  if (request.camera.orthographic()) return;
  const double x = (kRim + std::abs(clip_[2][0])) / clip_[0][0];
  const double y = (kRim + std::abs(clip_[2][1])) / clip_[1][1];
  largest_secant_ = std::sqrt(1.0 + x * x + y * y);
}

bool SeenSpace::isFinite() const {
  bool finite = isFiniteVector(glm::dvec4(shift_, pixels_at_one_)) && pixels_at_one_ > 0.0;
  for (int i = 0; i < 4; ++i) finite &= isFiniteVector(clip_[i]);
  for (int i = 0; i < 3; ++i) finite &= isFiniteVector(glm::dvec4(axes_[i], 0.0));
  return finite;
}

SeenBox SeenSpace::seenPart(const base::Aabb& box) const {
  SeenBox seen;
  for (const glm::dvec3& corner : boxCorners(box)) seen.add(toEye(corner));

  // Depths between the near and the far plane, where clip z is −w and w.
  const glm::dmat4& m = clip_;
  const double near_z = -(m[3][2] + m[3][3]) / (m[2][2] + m[2][3]);
  const double far_z = (m[3][3] - m[3][2]) / (m[2][2] - m[2][3]);
  const double rounding = (kRim - 1.0) * std::abs(near_z);
  seen.max.z = std::min(seen.max.z, m[2][3] != 0.0 ? near_z * (2.0 - kRim) : near_z + rounding);
  if (std::isfinite(far_z)) seen.min.z = std::max(seen.min.z, far_z - (kRim - 1.0) * std::abs(far_z));
  return betweenSides(seen);
}

SeenBox SeenSpace::betweenSides(SeenBox box) const {
  if (box.empty()) return box;
  // The sides are planes, so the widest place is at one of both depths.
  for (int axis = 0; axis < 2; ++axis) {
    const auto a = rangeAt(clip_, axis, box.min.z), b = rangeAt(clip_, axis, box.max.z);
    box.min[axis] = std::max(box.min[axis], std::min(a[0], b[0]));
    box.max[axis] = std::min(box.max[axis], std::max(a[1], b[1]));
  }
  return box;
}

double SeenSpace::largestScale(const SeenBox& box) const {
  if (isParallel()) return pixels_at_one_;
  // A step of length l from a place at the distance d and the depth z moves by l · d / z² at most, in units of the
  // picture at depth 1.
  const glm::dvec3 farthest = glm::max(glm::abs(box.min), glm::abs(box.max));
  const double depth = -box.max.z;
  const double aside = glm::length(glm::dvec2(farthest)) / depth;
  return pixels_at_one_ * std::min(largest_secant_, std::sqrt(1.0 + aside * aside)) / depth;
}

BoxCorners SeenSpace::toScene(const SeenBox& box) const {
  BoxCorners corners;
  for (int i = 0; i < 8; ++i) corners[static_cast<std::size_t>(i)] = toScene(box.corner(i));
  return corners;
}

}  // namespace lod::hlod
