#pragma once
// Chooses the sampling images of a frame, and finds which of them continue each other. No GL.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "client/render/lumigraph.h"

namespace client {

/// Geometry of a resident sample that choosing needs, computed once.
struct SampleGeometry {
  glm::mat4 clip_from_scene{1.0F};
  glm::vec3 eye{0.0F};
  float pixels_per_unit_at_one = 1.0F;
  base::Frustum frustum;
  std::array<glm::vec3, 4>
      corners;  ///< unit directions through the corners: left-bottom, right-bottom, right-top, left-top

  explicit SampleGeometry(const base::Camera& camera);
};

/// Returns the weight of a sample at a surface point for a viewer, before visibility. As
/// shaders/blend_fragment.glsl has it, but for errors of colours, which no single sample decides. `to_view`,
/// `to_sample`: from the point to both, of any length but zero. `ratio`: pixels per unit length of the sample over
/// those of the view. `error_px`: the proxy's typical error there.
float sampleWeight(const glm::vec3& to_view, const glm::vec3& to_sample, float ratio, float error_px,
                   const BlendTuning& tuning);

/// Returns the indices of up to `limit` of `samples`, in the order of what they add to the view. Buehler et al. 2001,
/// section 3, rank cameras per ray; for choosing, one ray for each box of the drawn surface is enough. Samples that see
/// no box are left out. `errors`: of the proxy in each box.
std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, std::span<const ProxyError> errors,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning);

/// Returns for each sample which share of its weight it keeps at its left, right, bottom and top border (0: it fades
/// out). Where another of these samples has the same centre and the same border (the next face of a cube, the next
/// tile), nothing has to fade, since the other continues there. `fades` (0..1) are the samples' fades in time: beside a
/// neighbour that is still fading in, the weight sinks to the neighbour's.
std::vector<glm::vec4> borderFloors(std::span<const SampleGeometry* const> samples, std::span<const float> fades);

}  // namespace client
