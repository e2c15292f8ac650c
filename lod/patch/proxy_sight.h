#pragma once
// Tells whether a coarse cut of the hierarchy hides one place from another, in about a microsecond and before any image
// is rendered. It serves the choice of images; lod/patch/ray_cast.h measures.
//
// The cut is a proxy, not the scan itself: details smaller than its error are missing. So both ends of a line of sight
// are drawn in by a clearance, as a shadow map has a bias.
#include <array>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/geometry.h"
#include "base/simd.h"
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

  /// The surface falls into cells: up to four triangles that lie together.
  struct Cell {
    glm::vec3 place{0.0F};  ///< on its surface
    float radius = 0.0F;    ///< no part of it is farther from the place, scene units
  };
  std::size_t cellCount() const { return leaves_.size(); }
  const Cell& cell(std::uint32_t number) const { return leaves_[number].cell; }

  struct Intersection {
    float distance = 0.0F;   ///< scene units
    glm::vec3 normal{0.0F};  ///< unit, of the triangle: towards the side from which its corners run counter-clockwise
    std::uint32_t cell = 0;  ///< below cellCount()
  };
  /// The nearest triangle along a ray, from either side. `direction`: unit; all is scene-local.
  std::optional<Intersection> nearest(const glm::vec3& origin, const glm::vec3& direction, float max_distance) const;

  /// Whether anything lies between two places farther than `clearance` (scene units, ≥ 0) from both along the line.
  bool isBlocked(const glm::vec3& from, const glm::vec3& to, float clearance) const;

  /// The stated error, scene units: a bound several times the typical distance.
  float error() const { return error_; }
  /// The box of all triangles; empty where there are none.
  const base::Aabb& box() const { return box_; }
  /// That of the box.
  float diagonal() const { return box_.empty() ? 0.0F : box_.diagonal(); }
  std::size_t triangleCount() const { return triangle_count_; }

 private:
  /// Children of a node, and triangles of a leaf: as many as a vector's lanes.
  static constexpr std::uint32_t kWidth = 4;
  /// The boxes of four children lie side by side, so that a ray is tested against all of them at once.
  struct Node {
    base::Float4 sides[2][3];                    ///< lowest, highest, by axis; NaN where no child is: never met
    std::array<std::uint32_t, kWidth> children;  ///< a node, or a leaf with kIsLeaf
  };
  static constexpr std::uint32_t kIsLeaf = 1U << 31;
  /// Up to four triangles; places without one hold one without area.
  struct Leaf {
    base::Float4 corners[3][3];  ///< by corner, then by axis
    Cell cell;
    glm::vec3 corner(std::size_t c, std::size_t place) const {
      return {corners[c][0][place], corners[c][1][place], corners[c][2][place]};
    }
  };
  struct TriangleNumber {
    std::uint32_t leaf = 0, place = 0;
  };
  class Builder;
  struct RayPart;

  template <class Visit>
  bool visitLeaf(const RayPart& ray, std::uint32_t number, const Visit& visit) const;
  template <bool kNearestFirst, class Visit>
  void walk(const RayPart& ray, const Visit& visit) const;

  std::vector<Node> nodes_;  ///< the root first; empty where there is no triangle
  std::vector<Leaf> leaves_;
  std::size_t triangle_count_ = 0;
  float error_ = 0.0F;
  base::Aabb box_;
};

}  // namespace lod::patch
