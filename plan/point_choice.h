#pragma once
// Chooses the sampling points and faces that serve a view best (Okamoto 2011, section 5.1, step 2: "the set of the
// nearest sampling points"). All functions are pure: the same input gives the same answer, in whatever order the
// samples come.
//
// We depart from the paper, which takes the nearest points only. A face spreads 512 pixels over 90°, a view perhaps
// 1280 over 60°. In images from the corners of the eye's own cell the surface is therefore about three times coarser
// than the view, while a point that lies between the eye and the surface shows it as finely as the view does. The use
// of point p for the piece of surface s that the eye e sees is
//
// clang-format off
//   use(p, s) = facing(p, s) / sqrt(r² + m²)                 1: as good as the view itself
//   r = max(1, (f_view / |s − e|) / (f_face / |s − p|))      view pixels that one image pixel covers; f in pixels
//   m = kTypicalError · error_px · tan(angle between s − e and s − p)
//                                                            view pixels by which a proxy's error shifts the image
//   facing = clamp((n · toPoint) / max(n · toEye, 0.2), 0, 1)
//                                                            n is the surface normal turned towards the eye; where
//                                                            it is not known, facing is the cosine of the angle
// clang-format on
//
// if nothing lies between p and s, and 0 otherwise. ProxySight (lod/patch/proxy_sight.h) tests this on a coarse cut;
// without one nothing counts as hidden. A set of points is worth Σ weight(s) · (best use + ½ · second best use), since
// two images of a place fill each other's holes and further ones add little. Points are chosen greedily by the worth
// that they add.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/view_defaults.h"
#include "lod/patch/hierarchy.h"
#include "lod/patch/proxy_sight.h"
#include "plan/sight_cache.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"

namespace plan {

/// Images shift by so much of the tolerance of the patches under them. Along an orbit over machangara the values 0,
/// 0.8, 1.6, 3.2 and 6.4 gave 26.9, 27.6, 27.9, 28.0 and 27.9 dB with cuts of about 1 px, and 26.3, 27.1, 27.1, 27.1
/// and 27.1 dB with cuts of about 2 px.
inline constexpr float kTypicalError = 2.0F;

/// A piece of surface that the view shows.
struct SurfaceSample {
  glm::vec3 position{0.0F};      ///< scene-local
  glm::vec3 normal{0.0F};        ///< unit length; zero where it is not known
  float weight = 1.0F;           ///< share of the picture
  std::uint32_t cell = kNoCell;  ///< of the proxy's surface (lod::patch::ProxySight::cellCount()), where it is known

  static constexpr std::uint32_t kNoCell = ~0U;
};

/// Rays that estimate the visible surface, across the picture and up.
inline constexpr int kSurfaceColumns = 16;
inline constexpr int kSurfaceRows = 9;

/// Estimates the visible surface from the boxes and normal cones of the cut's patches, by one ray through the middle of
/// each of columns × rows tiles of the picture; or of the part in which the model lies, where that is at most half of
/// it. A ray ends at the nearest patch that it meets. Where the patch's cone is narrow, it meets the plane through the
/// patch's centre, if that lies inside the box; otherwise it meets the patch half-way through the box.
std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::Hierarchy& hierarchy,
                                                std::span<const std::uint32_t> patches, const base::Camera& camera,
                                                int columns = kSurfaceColumns, int rows = kSurfaceRows);

/// Samples the visible surface on a coarse cut, by one ray through the middle of each such tile.
std::vector<SurfaceSample> sampleVisibleSurface(const lod::patch::ProxySight& sight, const base::Camera& camera,
                                                int columns = kSurfaceColumns, int rows = kSurfaceRows);

struct PointQuery {
  repository::Grid grid;
  const repository::SampleTree* tree = nullptr;          ///< the points that are sampled; null: all of the grid
  const lod::patch::ProxySight* sight = nullptr;         ///< tests occlusion; null: nothing hides anything
  SightCache* sight_cache = nullptr;                     ///< remembers what `sight` said; may be null
  glm::vec3 eye{0.0F};                                   ///< scene-local
  glm::vec4 section = base::kNoSection;                  ///< of the view's camera
  float pixels_per_unit_at_one = 1.0F;                   ///< base::Camera::pixelsPerUnitAtOne() of the view
  float error_px = base::ViewDefaults::kPatchTolerance;  ///< projected error of the client's proxy
  std::size_t max_points = base::ViewDefaults::kPoints;
};

/// Whether nothing lies between the two, as far as `query.sight` can tell. Like a shadow map with its bias, it ignores
/// surfaces within half its stated error of either end.
bool isInSight(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample);
/// The clearance that it keeps, scene units.
float sightClearance(const lod::patch::ProxySight& sight);

/// isInSight() for one point of the grid and many samples. Where the query has a cache, it answers for samples in cells
/// that look small both from the eye and from the point.
class SightOfPoint {
 public:
  SightOfPoint(const PointQuery& query, const glm::uvec3& point);
  bool sees(const SurfaceSample& sample) const;

 private:
  const PointQuery& query_;
  glm::vec3 place_;
  std::shared_ptr<SightCache::Row> row_;
};

/// use(p, s) of the formula above for an s that p sees, 0..1.
float useOfPoint(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample);

/// Chooses at most max_points grid points, all of them of some use, in the order of the worth that they add. The
/// candidates are the corners of the eye's cell (the tree's, where there is one) and of the cells along the lines from
/// the eye to the samples; the 256 most promising are considered. The eye's own corners have no privilege: choosing
/// four of the eight in any case cost 0.4 dB on machangara's grid of 17 points.
std::vector<glm::uvec3> choosePoints(const PointQuery& query, std::vector<SurfaceSample> samples);

/// A chosen point and the worth that it adds to those before it. The gains sum up to the worth of the set.
struct ChosenPoint {
  glm::uvec3 point{0};
  float gain = 0.0F;
};
std::vector<ChosenPoint> choosePointsWithGains(const PointQuery& query, std::vector<SurfaceSample> samples);

/// The faces of these points that show at least one sample (use above 0), in the order of the worth that they add.
std::vector<repository::FaceKey> orderFaces(const PointQuery& query, std::span<const glm::uvec3> points,
                                            std::vector<SurfaceSample> samples);

}  // namespace plan
