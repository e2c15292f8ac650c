#pragma once
// Scenes of spheres and rectangles, with two independent ways to a picture: casting rays, and proxies of them as
// patches.
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "base/camera.h"
#include "base/image.h"
#include "lod/patch/hierarchy.h"

namespace testing_scene {

using Color = std::function<glm::vec3(const glm::vec3& point)>;  ///< 0..1

struct Ball {
  glm::vec3 center;
  float radius;
  Color color;
};

/// Points center + u·a + v·b with −1 ≤ u, v ≤ 1. `back`, where set, colours the side that cross(a, b) points away from.
struct Rectangle {
  glm::vec3 center, a, b;
  Color color;
  Color back;
};

struct Scene {
  std::vector<Ball> balls;
  std::vector<Rectangle> rectangles;
};

/// Casts rays: coverage (0 or 255) is the majority of n × n rays a pixel, the colour is the mean of covered rays.
base::Image castRays(const Scene& scene, const base::Camera& camera, int rays = 2);

inline const lod::Lattice kLattice{glm::dvec3(-8.0), 1.0 / 65536.0};

/// Returns a sphere of 2 · rings² triangles (rings ≤ 120), vertices at the given radius, outward normals, one colour.
lod::patch::PatchGeometry ballPatch(const glm::vec3& center, float radius, int rings, glm::u8vec4 color);
/// Returns a rectangle of 2 · cells² triangles, normals along cross(a, b).
lod::patch::PatchGeometry rectanglePatch(const Rectangle& rectangle, int cells, glm::u8vec4 color);

/// Looking from `eye` at `target`, up nearest to +z (or +y where that is the view).
base::Camera lookAt(const glm::vec3& eye, const glm::vec3& target, int width, int height, float fov_y_degrees);
/// Returns a camera of parallel rays, `ortho_height` scene units from the bottom of the picture to its top. The picture
/// holds all that is within 4 of zero.
base::Camera lookAlong(const glm::vec3& eye, const glm::vec3& target, int width, int height, float ortho_height);
/// Returns the six 90° cameras around a point.
std::vector<base::Camera> cubeCameras(const glm::vec3& eye, int size);

/// Returns 10 log10(255² / mean squared error) over pixels that both call model; 99 where equal.
double psnrOnCovered(const base::Image& a, const base::Image& b);
/// Returns the pixels covered by both pictures divided by those covered by either.
double coverageOverlap(const base::Image& a, const base::Image& b);

}  // namespace testing_scene
