#pragma once
// Tells by ray casting (Embree) what light reaches the places of a surface that a picture shows: the truth for shadows.
#include <embree3/rtcore.h>

#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>
#include <limits>
#include <memory>
#include <optional>
#include <type_traits>
#include <vector>

#include "base/camera.h"
#include "base/image.h"
#include "lod/hlod/shadow_cut.h"
#include "tests/support/mesh.h"

namespace support {

/// A place of the surface that a ray from the eye meets.
struct SeenPlace {
  glm::dvec3 place{0.0};
  glm::dvec3 plane{0.0};   ///< unit normal of the triangle, turned towards the viewer
  glm::dvec3 normal{0.0};  ///< interpolated between the vertices, turned to the same side
};

class ShadowTruth {
 public:
  explicit ShadowTruth(const Mesh& mesh) : mesh_(mesh), normals_(mesh.normals) {
    if (normals_.empty()) normals_ = vertexNormals(mesh);
    device_.reset(rtcNewDevice("threads=1"));
    scene_.reset(rtcNewScene(device_.get()));
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* places = static_cast<glm::vec3*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(glm::vec3), mesh.positions.size()));
    std::copy(mesh.positions.begin(), mesh.positions.end(), places);
    auto* corners = static_cast<std::uint32_t*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(std::uint32_t), mesh.triangleCount()));
    std::copy(mesh.indices.begin(), mesh.indices.end(), corners);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_.get(), geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_.get());
    const base::Aabb box = mesh.box();
    center_ = glm::dvec3(box.center());
    offset_ = 2e-6 * static_cast<double>(glm::length(box.size()));
  }

  /// `at`: pixels from the picture's top left corner.
  std::optional<SeenPlace> seenAt(const base::Camera& camera, const glm::dvec2& at) const {
    const glm::dmat4 scene_from_clip =
        glm::inverse(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene));
    const glm::dvec2 ndc(2.0 * at.x / camera.width - 1.0, 1.0 - 2.0 * at.y / camera.height);
    const auto unproject = [&](double depth) {
      const glm::dvec4 place = scene_from_clip * glm::dvec4(ndc, depth, 1.0);
      return glm::dvec3(place) / place.w;
    };
    const glm::dvec3 from = unproject(-1.0), direction = unproject(1.0) - from;
    RTCRayHit ray{};
    setRay(ray.ray, from, direction, 1.0);
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_.get(), &context, &ray);
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    return placeOf(ray.hit, direction);
  }

  /// Whether nothing lies between a place and the light's place or direction (w = 1 or 0).
  bool isLit(const SeenPlace& seen, const glm::dvec4& light) const {
    const glm::dvec3 from = seen.place + offset_ * seen.plane;
    RTCRay ray{};
    setRay(ray, from, glm::dvec3(light) - light.w * from,
           light.w > 0.0 ? 1.0 : static_cast<double>(std::numeric_limits<float>::infinity()));
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene_.get(), &context, &ray);
    return ray.tfar >= 0.0F;
  }

  /// The share of the light's disc that is seen, by `samples` of it. The disc faces the surface's middle.
  double litShare(const SeenPlace& seen, const lod::hlod::ShadowLight& light, int samples) const {
    const glm::dvec4 middle(light.place);
    const glm::dvec3 axis = glm::normalize(glm::dvec3(middle) - middle.w * center_);
    const glm::dvec3 right =
        glm::normalize(glm::cross(axis, std::abs(axis.x) < 0.6 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
    const glm::dvec3 up = glm::cross(axis, right);
    const double half = 0.5 * static_cast<double>(light.size);
    const double radius = middle.w > 0.0 ? half : std::tan(half);
    int lit = 0;
    for (int i = 0; i < samples; ++i) {
      // The golden angle, and equal areas.
      const double r = radius * std::sqrt((i + 0.5) / samples), angle = 2.399963229728653 * i;
      lit += isLit(seen, middle + glm::dvec4(r * (std::cos(angle) * right + std::sin(angle) * up), 0.0)) ? 1 : 0;
    }
    return static_cast<double>(lit) / samples;
  }

 private:
  static void setRay(RTCRay& ray, const glm::dvec3& from, const glm::dvec3& direction, double far) {
    ray.org_x = static_cast<float>(from.x), ray.org_y = static_cast<float>(from.y);
    ray.org_z = static_cast<float>(from.z);
    ray.dir_x = static_cast<float>(direction.x), ray.dir_y = static_cast<float>(direction.y);
    ray.dir_z = static_cast<float>(direction.z);
    ray.tnear = 0.0F;
    ray.tfar = static_cast<float>(far);
    ray.mask = ~0U;
  }

  SeenPlace placeOf(const RTCHit& hit, const glm::dvec3& direction) const {
    const auto corner = [&](std::size_t k) { return mesh_.indices[3 * std::size_t{hit.primID} + k]; };
    const glm::dvec3 a(mesh_.positions[corner(0)]), b(mesh_.positions[corner(1)]), c(mesh_.positions[corner(2)]);
    const double u = static_cast<double>(hit.u), v = static_cast<double>(hit.v);
    SeenPlace seen;
    seen.place = (1.0 - u - v) * a + u * b + v * c;
    seen.plane = glm::normalize(glm::cross(b - a, c - a));
    seen.normal = glm::normalize((1.0 - u - v) * glm::dvec3(normals_[corner(0)]) + u * glm::dvec3(normals_[corner(1)]) +
                                 v * glm::dvec3(normals_[corner(2)]));
    if (glm::dot(seen.plane, direction) > 0.0) seen.plane = -seen.plane;
    if (glm::dot(seen.normal, seen.plane) < 0.0) seen.normal = -seen.normal;
    return seen;
  }

  struct Release {
    void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  };
  const Mesh& mesh_;
  std::vector<glm::vec3> normals_;
  std::unique_ptr<std::remove_pointer_t<RTCDevice>, Release> device_;
  std::unique_ptr<std::remove_pointer_t<RTCScene>, Release> scene_;
  glm::dvec3 center_{0.0};
  double offset_ = 0.0;
};

/// The cosine of the light's angle to the interpolated normal.
inline double facing(const SeenPlace& seen, const lod::hlod::ShadowLight& light) {
  const glm::dvec4 middle(light.place);
  return glm::dot(seen.normal, glm::normalize(glm::dvec3(middle) - middle.w * seen.place));
}

/// How a picture of white surfaces with hard shadows compares to the truth.
struct EdgeCount {
  int edges = 0;    ///< pixels with both light and shadow so near
  int wrong = 0;    ///< pixels that show what is nowhere so near
  int checked = 0;  ///< pixels of the surface that face the light
};

/// A wrong pixel's edge is off by more than half a pixel, or by that divided by the light's cosine (Guthe et al. 2004,
/// section 4.1); speckles and leaks count, too. At creases the picture may show any place that is so near. Pixels count
/// where the cosine is at least `least_facing`.
inline EdgeCount compareEdges(const base::Image& picture, const base::Camera& camera, const ShadowTruth& truth,
                              const lod::hlod::ShadowLight& light, double least_facing) {
  EdgeCount count;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      const auto middle = truth.seenAt(camera, {x + 0.5, y + 0.5});
      if (!middle || picture.at(x, y)[3] < 255) continue;
      const double cosine = facing(*middle, light);
      if (cosine < least_facing) continue;
      int lit = 0, dark = 0;
      double least = cosine, most = cosine;
      constexpr int kSteps = 4;
      const double reach = 0.5 / cosine;
      for (int i = -kSteps; i <= kSteps; ++i)
        for (int k = -kSteps; k <= kSteps; ++k) {
          const glm::dvec2 off = reach * glm::dvec2(i, k) / static_cast<double>(kSteps);
          if (glm::length(off) > reach) continue;
          const auto seen = truth.seenAt(camera, glm::dvec2(x + 0.5, y + 0.5) + off);
          if (!seen) continue;
          (truth.isLit(*seen, glm::dvec4(light.place)) ? lit : dark) += 1;
          least = std::min(least, std::max(facing(*seen, light), 0.0));
          most = std::max(most, facing(*seen, light));
        }
      ++count.checked;
      if (lit > 0 && dark > 0) ++count.edges;
      const auto isLighter = [&](double half_lit) { return picture.at(x, y)[0] > 255.0 * (0.35 + 0.65 * half_lit); };
      if ((lit == 0 && isLighter(0.5 * most)) || (dark == 0 && !isLighter(0.5 * least))) ++count.wrong;
    }
  return count;
}

/// Grey levels by which a picture of white surfaces is off in penumbrae.
struct PenumbraError {
  double mean = 0.0;
  int largest = 0;
  int pixels = 0;  ///< within penumbrae
};

/// `samples`: places in a pixel along each side, with 256 rays to the light together.
inline PenumbraError comparePenumbrae(const base::Image& picture, const base::Camera& camera, const ShadowTruth& truth,
                                      const lod::hlod::ShadowLight& light, int samples = 1) {
  PenumbraError error;
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) {
      double brightness = 0.0, share = 0.0;
      bool counts = picture.at(x, y)[3] == 255;
      for (int i = 0; i < samples * samples && counts; ++i) {
        const glm::dvec2 off = (glm::dvec2(i % samples, i / samples) + 0.5) / static_cast<double>(samples);
        const auto seen = truth.seenAt(camera, glm::dvec2(x, y) + off);
        counts = seen && facing(*seen, light) > 0.1;
        if (!counts) continue;
        const double here = truth.litShare(*seen, light, 256 / (samples * samples));
        share += here / (samples * samples);
        brightness += (0.35 + 0.65 * facing(*seen, light) * here) / (samples * samples);
      }
      if (!counts || share <= 0.0 || share >= 1.0) continue;
      const double off = std::abs(picture.at(x, y)[0] - 255.0 * brightness);
      error.mean += off;
      error.largest = std::max(error.largest, static_cast<int>(std::lround(off)));
      ++error.pixels;
    }
  error.mean /= std::max(error.pixels, 1);
  return error;
}

}  // namespace support
