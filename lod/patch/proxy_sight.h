#pragma once
// Tells whether a coarse cut of the hierarchy hides one place from another, in about a microsecond and before any image
// is rendered. It serves the choice of images; lod/patch/ray_cast.h measures.
//
// The cut is a proxy, not the scan itself: details smaller than its error are missing. So both ends of a line of sight
// are drawn in by a clearance, as a shadow map has a bias.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/geometry.h"
#include "lod/patch/format.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

class ProxySight {
 public:
  /// With this many triangles a scan's buildings, trees or folds are still there; they take 4 MB and 50 ms to load.
  static constexpr std::uint64_t kUsualTriangles = 60'000;

  using GeometryOf = std::function<base::Result<PatchGeometry>(std::uint32_t patch)>;

  /// Takes the patches of a cut whose largest stated error (scene units) is `error`. Errors: those of `geometry_of`.
  static base::Result<ProxySight> ofPatches(const Hierarchy& hierarchy, std::span<const std::uint32_t> patches,
                                            float error, const GeometryOf& geometry_of);
  /// Takes the finest uniform cut of at most `max_triangles` triangles, or the coarsest there is.
  static base::Result<ProxySight> ofFile(const PatchFile& file, std::uint64_t max_triangles = kUsualTriangles);

  struct Intersection {
    float distance = 0.0F;   ///< scene units
    glm::vec3 normal{0.0F};  ///< unit, of the triangle: towards the side from which its corners run counter-clockwise
  };
  /// The nearest triangle along a ray, from either side. `direction`: unit; all is scene-local.
  std::optional<Intersection> nearest(const glm::vec3& origin, const glm::vec3& direction, float max_distance) const;

  /// Whether anything lies between two places farther than `clearance` (scene units, ≥ 0) from both along the line.
  bool isBlocked(const glm::vec3& from, const glm::vec3& to, float clearance) const;

  /// The stated error, scene units: a bound several times the typical distance.
  float error() const { return error_; }
  std::size_t triangleCount() const { return triangles_.size(); }

 private:
  struct Triangle {
    glm::vec3 a, b, c;
  };
  /// A leaf has triangles first … first + count − 1; any other node has count 0, its near child next to it and the
  /// other at `first`.
  struct Node {
    base::Aabb box;
    std::uint32_t first = 0;
    std::uint32_t count = 0;
  };

  void build(std::uint32_t first, std::uint32_t count);
  template <class Visit>
  void walk(const glm::dvec3& origin, const glm::dvec3& direction, double from, double& to, const Visit& visit) const;

  std::vector<Triangle> triangles_;  ///< in the order of the leaves
  std::vector<Node> nodes_;          ///< the root first
  float error_ = 0.0F;
};

}  // namespace lod::patch
