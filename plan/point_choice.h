#pragma once
// Which sampling points and faces serve a view best (Okamoto 2011, section 5.1, step 2: "the set of the nearest
// sampling points"; DESIGN section 6, steps 2 and 3). Pure functions: the same input gives the same answer, in whatever
// order samples come.
//
// Departure from the paper, which takes the nearest points only. A face spreads 512 pixels over 90°, a view perhaps
// 1280 over 60°: seen from the corners of the eye's own cell the surface is blurred three times over, while a point
// that lies between the eye and the surface shows it as finely as the view does. So the use of point p for the piece of
// surface s that the eye e sees is
//
//   use(p, s) = facing(p, s) / sqrt(r² + m²)        1 = as good as the view itself
//   r = max(1, (f_view / |s − e|) / (f_face / |s − p|))     view pixels that one pixel of the image covers; f in pixels
//   m = kTypicalError · error_px · tan(angle between s − e and s − p)       view pixels by which a proxy that is off by
//   error_px shifts the image facing = clamp((n · toPoint) / max(n · toEye, 0.2), 0, 1), n the surface normal turned
//   towards the eye;
//            the cosine of that angle where the normal is not known
//
// where nothing lies between p and s, else 0 (lod/patch/proxy_sight.h: on a coarse cut; without one nothing hides
// anything), and a set of points is worth Σ weight(s) · (best use + ½ · second best use): two images a place fill each
// other's holes, more add little. Points are added greedily by what they add to that sum.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/camera.h"
#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace plan {

/// The stated error is an upper bound; what an image is off by, seen from aside, is a share of it. Measured along an
/// orbit over machangara with cuts of 4 and 8 px: 0, 0.2, 0.4, 0.8, 1.6 gave 26.9, 27.6, 27.9, 28.0, 27.9
/// and 26.3, 27.1, 27.1, 27.1, 27.1 dB.
inline constexpr float kTypicalError = 0.5F;

/// A piece of surface that the view shows.
struct SurfaceSample {
  glm::vec3 position{0.0F};  ///< scene-local
  glm::vec3 normal{0.0F};    ///< unit; zero: not known
  float weight = 1.0F;       ///< share of the picture
};

/// What the eye sees, guessed from the boxes and normal cones of the cut's patches: one ray through the middle of each
/// of columns × rows tiles of the picture. A ray ends at the nearest patch whose box it crosses: where it meets the
/// plane through the patch's centre when the cone is narrow (and passes the patch when it does not meet it inside the
/// box), else half-way through the box.
std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::Hierarchy& hierarchy,
                                                std::span<const std::uint32_t> patches, const base::Camera& camera,
                                                int columns = 16, int rows = 9);

/// The same where a coarse cut is at hand to look at: one ray through the middle of each tile, to where it meets the
/// cut.
std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::ProxySight& sight, const base::Camera& camera,
                                                int columns = 16, int rows = 9);

struct PointQuery {
  repository::Grid grid;
  const repository::SampleTree* tree = nullptr;   ///< which points are sampled; null: all of the grid
  const lod::patch::ProxySight* sight = nullptr;  ///< what hides what; null: nothing hides anything
  glm::vec3 eye{0.0F};                            ///< scene-local
  float pixels_per_unit_at_one = 1.0F;            ///< base::Camera::pixelsPerUnitAtOne() of the view
  float error_px = 4.0F;                          ///< projected error of the client's proxy
  std::size_t max_points = 8;
};

/// Whether nothing lies between them, as far as `query.sight` tells: within half its stated error of either end it does
/// not, like a shadow map within its bias.
bool isInSight(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample);

/// use(p, s) of the formula above, 0..1, if s is in sight of p.
float useOfPoint(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample);

/// The chosen grid points, in the order of what each adds, at most max_points, all of some use. Candidates are the
/// corners of the eye's cell (the tree's, where there is one) and of the cells along the lines from the eye to the
/// samples, the 256 most promising. None of the eye's own corners is taken for its own sake: that four of the eight
/// were always among them cost 0.4 dB on machangara's grid of 17.
std::vector<glm::uvec3> choosePoints(const PointQuery& query, std::vector<SurfaceSample> samples);

/// A chosen point and what it adds to the sum above once those before it are there; the gains sum up to the set's
/// worth.
struct ChosenPoint {
  glm::uvec3 point{0};
  float gain = 0.0F;
};
std::vector<ChosenPoint> choosePointsWithGains(const PointQuery& query, std::vector<SurfaceSample> samples);

/// The faces of these points that show at least one sample (use above 0), in the order in which each adds most to the
/// sum above.
std::vector<repository::FaceKey> orderFaces(const PointQuery& query, std::span<const glm::uvec3> points,
                                            std::vector<SurfaceSample> samples);

}  // namespace plan
