#pragma once
// Which sampling images a frame uses, and how they hang together. No GL.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "client/render/lumigraph.h"

namespace client {

/// What choosing needs to know of a resident sample, worked out once.
struct SampleGeometry {
  glm::mat4 clip_from_scene{1.0F};
  glm::vec3 eye{0.0F};
  float pixels_per_unit_at_one = 1.0F;
  base::Frustum frustum;
  std::array<glm::vec3, 4>
      corners;  ///< unit directions through the image's corners: left-bottom, right-bottom, right-top, left-top

  explicit SampleGeometry(const base::Camera& camera);
};

/// The weight of a sample at a surface point for a viewer, before visibility: the same formula as the shader's
/// (shaders/blend_fragment.glsl). `to_view`, `to_sample`: from the point to both, of any length but zero. `ratio`:
/// pixels per unit length of the sample over those of the view. `error_px`: the proxy's error there.
float sampleWeight(const glm::vec3& to_view, const glm::vec3& to_sample, float ratio, float error_px,
                   const BlendTuning& tuning);

/// Up to `limit` of `samples`, by index, in the order of what they add to the view. Buehler et al. 2001, section 3,
/// rank cameras per ray; to choose, one ray per box of the drawn surface is enough. Samples that see no box are left
/// out.
std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, const base::Camera& view, std::size_t limit,
                                       float error_px, const BlendTuning& tuning);

/// For each sample, what its weight keeps at its left, right, bottom and top border (0: fades out). Where another of
/// these samples has the same centre and the same border (the next face of a cube, the next tile) nothing has to fade:
/// the other goes on where this one ends. `fades` (0..1) are the samples' fades in time: beside a neighbour that is
/// still coming in, the weight sinks to the neighbour's.
std::vector<glm::vec4> borderFloors(std::span<const SampleGeometry* const> samples, std::span<const float> fades);

}  // namespace client
