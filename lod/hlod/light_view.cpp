#include "lod/hlod/light_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::hlod {
namespace {

/// One perspective picture reaches at most so far aside of its axis, as a tangent: 60°. Beyond it texels at the rim
/// would be far smaller than needed, and six faces of 90° serve better. A choice.
constexpr double kWidest = 1.7320508;
/// Near planes beyond this share of the far one leave 24 depth bits enough precision, as for views (base/camera.h).
constexpr double kNearestShare = 1.0 / 20000.0;
/// Float32 places of a picture are off by at most this share of the coordinates they are computed from: four terms,
/// each rounded twice.
constexpr double kRounding = 1e-6;
/// Windows of perspective pictures grow by at most this tangent on that account; nearer receivers are within rounding
/// of the light.
constexpr double kMaxRoundingTangent = 0.01;

glm::dmat3 axesAlong(const glm::dvec3& forward, const glm::dvec3& up) {
  const glm::dvec3 back = -glm::normalize(forward);
  const glm::dvec3 right = glm::normalize(glm::cross(up, back));
  return {right, glm::cross(back, right), back};
}

/// Corner numbers of the six sides of a box, around each.
constexpr std::array<std::array<std::size_t, 4>, 6> kSides{
    {{0, 2, 6, 4}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 1, 3, 2}, {4, 5, 7, 6}}};

/// The part of a convex polygon with dot(normal, p) >= 0 (Sutherland and Hodgman 1974).
std::vector<glm::dvec3> clipped(const std::vector<glm::dvec3>& polygon, const glm::dvec3& normal) {
  std::vector<glm::dvec3> part;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const glm::dvec3 &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double at_a = glm::dot(normal, a), at_b = glm::dot(normal, b);
    if (at_a >= 0.0) part.push_back(a);
    if ((at_a >= 0.0) != (at_b >= 0.0)) part.push_back(a + (at_a / (at_a - at_b)) * (b - a));
  }
  return part;
}

}  // namespace

LightView::LightView(const glm::dmat3& axes, const glm::dvec3& place, bool is_parallel)
    : axes_(axes), place_(place), is_parallel_(is_parallel) {}

void LightView::add(const glm::dvec3& local) {
  min_ = glm::min(min_, toPicture(local));
  max_ = glm::max(max_, toPicture(local));
  near_ = std::min(near_, -local.z);
  far_ = std::max(far_, -local.z);
}

LightView LightView::parallel(const glm::dmat3& axes, const BoxCorners& box) {
  glm::dvec3 center(0.0);
  for (const glm::dvec3& corner : box) center += 0.125 * corner;
  LightView view(axes, center, true);
  for (const glm::dvec3& corner : box) view.add(view.toLight(corner));
  return view;
}

std::optional<LightView> LightView::perspective(const glm::dmat3& axes, const glm::dvec3& place,
                                                const BoxCorners& box) {
  LightView view(axes, place, false);
  for (const glm::dvec3& corner : box) {
    const glm::dvec3 local = view.toLight(corner);
    if (!(std::max(std::abs(local.x), std::abs(local.y)) <= -kWidest * local.z)) return std::nullopt;
    if (local.z == 0.0) return std::nullopt;
    view.add(local);
  }
  return view;
}

void LightView::addPolygon(std::vector<glm::dvec3> polygon) {
  for (const glm::dvec3& side :
       {glm::dvec3(1, 0, -1), glm::dvec3(-1, 0, -1), glm::dvec3(0, 1, -1), glm::dvec3(0, -1, -1)})
    polygon = clipped(polygon, side);
  for (const glm::dvec3& local : polygon) {
    if (local.z < 0.0) {
      add(local);
    } else {  // the light itself, from which all directions are seen
      min_ = glm::dvec2(-1.0), max_ = glm::dvec2(1.0);
      near_ = 0.0;
    }
  }
}

std::optional<LightView> LightView::face(const glm::dmat3& axes, const glm::dvec3& place, const BoxCorners& box,
                                         bool surrounds) {
  LightView view(axes, place, false);
  for (const auto& side : kSides) {
    std::vector<glm::dvec3> polygon;
    for (const std::size_t corner : side) polygon.push_back(view.toLight(box[corner]));
    view.addPolygon(std::move(polygon));
  }
  if (!(view.far_ > 0.0)) return std::nullopt;
  if (surrounds) view.min_ = glm::dvec2(-1.0), view.max_ = glm::dvec2(1.0), view.near_ = 0.0;
  // Neighbouring faces overlap a little, so that no place lies between.
  view.min_ = glm::max(view.min_, glm::dvec2(-1.0));
  view.max_ = glm::min(view.max_, glm::dvec2(1.0));
  return view;
}

void LightView::widen(double coordinate) {
  const double aside = kRounding * (coordinate + std::max(std::abs(glm::dot(place_, axes_[0])),  // as in the matrix
                                                          std::abs(glm::dot(place_, axes_[1]))));
  const double along = kRounding * (coordinate + std::abs(glm::dot(place_, axes_[2])));
  double step = aside;
  if (!is_parallel_) step = std::min((aside + along) / std::max(near_, 1e-30), kMaxRoundingTangent);
  min_ -= step, max_ += step;
  near_ -= along, far_ += along;
}

double LightView::largestDepth(const BoxCorners& corners) const {
  double depth = -std::numeric_limits<double>::infinity();
  for (const glm::dvec3& corner : corners) depth = std::max(depth, -toLight(corner).z);
  return std::min(depth, far_);
}

double LightView::leastDepth(const base::Aabb& box) const {
  double depth = std::numeric_limits<double>::infinity();
  for (const glm::dvec3& corner : boxCorners(box)) depth = std::min(depth, -toLight(corner).z);
  if (is_parallel_) return depth;
  // The window's rays are at most so much longer than their depth.
  const glm::dvec2 aside = glm::max(glm::abs(min_), glm::abs(max_));
  const double distance = glm::length(glm::clamp(place_, glm::dvec3(box.min), glm::dvec3(box.max)) - place_);
  return std::max(depth, distance / std::sqrt(1.0 + glm::dot(aside, aside)));
}

bool LightView::mayHold(const BoxCorners& corners) const {
  bool left = true, right = true, below = true, above = true, behind = true;
  for (const glm::dvec3& corner : corners) {
    const glm::dvec3 local = toLight(corner);
    const double unit = is_parallel_ ? 1.0 : -local.z;
    left &= local.x<min_.x * unit, right &= local.x> max_.x * unit;
    below &= local.y<min_.y * unit, above &= local.y> max_.y * unit;
    behind &= !is_parallel_ && local.z > 0.0;
  }
  return !(left || right || below || above || behind);
}

base::Camera LightView::camera(double near_depth, const glm::ivec2& texels) const {
  base::Camera camera;
  glm::dvec3 eye = place_;
  double far_depth = far_;
  if (is_parallel_) {  // the eye lies in the near plane, beyond all casters
    eye -= near_depth * axes_[2];
    far_depth -= near_depth;
    camera.clip_from_eye = glm::mat4(glm::ortho(min_.x, max_.x, min_.y, max_.y, 0.0, far_depth));
  } else {
    const double n = std::max(near_depth, kNearestShare * far_depth);
    camera.clip_from_eye = glm::mat4(glm::frustum(n * min_.x, n * max_.x, n * min_.y, n * max_.y, n, far_depth));
  }
  glm::dmat4 eye_from_scene(glm::transpose(axes_));
  eye_from_scene[3] = glm::dvec4(-(eye * axes_), 1.0);
  camera.eye_from_scene = glm::mat4(eye_from_scene);
  camera.eye = glm::vec3(eye);
  camera.width = texels.x, camera.height = texels.y;
  return camera;
}

std::array<glm::dvec4, 5> LightView::casterPlanes(const ShadowLight& light) const {
  const double radius = 0.5 * static_cast<double>(light.size);
  // In the light's axes, those at the sides first. The disc of a far light is seen under the same angle everywhere, so
  // its rays leave the window as they go up from the farthest receivers; a near one's stay within its radius.
  const double slope = is_parallel_ ? std::tan(std::min(radius, 1.5)) : 0.0;
  std::array<glm::dvec4, 5> planes;
  for (int axis = 0; axis < 2; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      const double end = sign > 0.0 ? min_[axis] : max_[axis];
      glm::dvec4 plane(0.0);
      plane[axis] = sign;
      plane.z = is_parallel_ ? slope : sign * end;
      plane.w = is_parallel_ ? slope * far_ - sign * end : radius * std::sqrt(1.0 + end * end);
      planes[static_cast<std::size_t>(2 * axis + (sign > 0.0 ? 0 : 1))] = plane;
    }
  }
  planes[4] = glm::dvec4(0.0, 0.0, 1.0, is_parallel_ ? far_ : std::max(far_, radius));
  for (glm::dvec4& plane : planes) {
    plane /= glm::length(glm::dvec3(plane));
    const glm::dvec3 normal = axes_ * glm::dvec3(plane);
    plane = glm::dvec4(normal, plane.w - glm::dot(normal, place_));
  }
  return planes;
}

namespace {

/// The roll about the light's direction whose window is the smallest: one with a side along one of the box's edges.
/// `view`: gives the view along some axes, if there is one.
template <class ViewAlong>
std::optional<LightView> smallestView(const glm::dvec3& forward, const glm::dmat3& box_axes, const ViewAlong& view) {
  std::optional<LightView> smallest;
  for (int axis = 0; axis < 3; ++axis) {
    // An edge along the light leaves the roll open; two edges never lie so.
    if (glm::length(glm::cross(box_axes[axis], forward)) < 0.01) continue;
    const auto found = view(axesAlong(forward, box_axes[axis]));
    const auto area = [](const LightView& of) { return of.size().x * of.size().y; };
    if (found && (!smallest || area(*found) < area(*smallest))) smallest = found;
  }
  return smallest;
}

std::vector<LightView> facesAround(const glm::dvec3& place, const BoxCorners& corners, const glm::dmat3& box_axes,
                                   bool surrounds) {
  std::vector<LightView> views;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      const auto view =
          LightView::face(axesAlong(sign * box_axes[axis], box_axes[(axis + 1) % 3]), place, corners, surrounds);
      if (view) views.push_back(*view);
    }
  return views;
}

}  // namespace

std::vector<LightView> viewsFrom(const ShadowLight& light, const SeenBox& box, const SeenSpace& space) {
  const BoxCorners corners = space.toScene(box);
  const glm::dvec3 place(light.place);
  if (light.place.w == 0.0F) {
    const auto view = [&](const glm::dmat3& axes) { return std::optional(LightView::parallel(axes, corners)); };
    return {*smallestView(-glm::normalize(place), space.axes(), view)};
  }
  const bool surrounds = box.contains(space.toEye(place));
  if (!surrounds) {
    const auto view = [&](const glm::dmat3& axes) { return LightView::perspective(axes, place, corners); };
    const glm::dvec3 towards = space.toScene(0.5 * (box.min + box.max)) - place;
    if (const auto smallest = smallestView(glm::normalize(towards), space.axes(), view)) return {*smallest};
  }
  return facesAround(place, corners, space.axes(), surrounds);
}

}  // namespace lod::hlod
