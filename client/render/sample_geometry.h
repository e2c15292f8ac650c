#pragma once
// Geometry of a resident sample, and which samples of one point lie within each other. No GL.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"

namespace client {

/// Holds, computed once, the geometry that choosing and blending need of a sample. Its *core* is the part of its
/// picture that is its own: a share of the width and of the height around the middle. Beyond the core lie pixels of its
/// neighbours, which only serve filters.
struct SampleGeometry {
  glm::mat4 clip_from_scene{1.0F};  ///< of the whole picture
  glm::vec3 eye{0.0F};
  float pixels_per_unit_at_one = 1.0F;
  float core = 1.0F;                 ///< above 0, at most 1
  base::Frustum frustum;             ///< of the core
  std::array<glm::vec3, 4> corners;  ///< unit directions through the core's: left-bottom, right-bottom, right-top,
                                     ///< left-top

  explicit SampleGeometry(const base::Camera& camera, float core_share = 1.0F);

  /// A direction's homogeneous place in the core: x and y divided by z are −1 … 1 there, and z is its part along the
  /// viewing direction.
  glm::vec3 placeInCore(const glm::vec3& direction) const;
};

/// Whether both have the same centre of projection.
bool sameCentre(const SampleGeometry& a, const SampleGeometry& b);

/// For each of some samples those of the same centre whose core holds its own and that are coarser, and those of which
/// that is true the other way round; as a tile of a face and the tiles that it is divided into.
struct SampleNesting {
  std::vector<std::vector<std::uint32_t>> coarser;
  std::vector<std::vector<std::uint32_t>> finer;
};
SampleNesting nestingOf(std::span<const SampleGeometry* const> samples);

/// Returns the numbers of samples so that those that lie within each other stand together, the finest first. All others
/// keep their order. `groups`, beside the result, differ where another set of such samples begins.
std::vector<std::uint32_t> finestFirst(std::span<const SampleGeometry* const> samples, const SampleNesting& nesting,
                                       std::vector<std::uint32_t>* groups);

}  // namespace client
