#pragma once
// Chooses the sampling images of a frame. No GL.
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "client/render/lumigraph.h"
#include "client/render/sample_geometry.h"

namespace client {

/// Returns the weight of a sample at a surface point for a viewer, before visibility. As
/// shaders/blend_samples.glsl has it, but for errors of colours, which no single sample decides. `to_view`,
/// `to_sample`: from the point to both, of any length but zero. `ratio`: pixels per unit length of the sample over
/// those of the view. `error_px`: the proxy's typical error there.
float sampleWeight(const glm::vec3& to_view, const glm::vec3& to_sample, float ratio, float error_px,
                   const BlendTuning& tuning);

/// Returns the indices of up to `limit` of `samples`, in the order of what they add to the view. Buehler et al. 2001,
/// section 3, rank cameras per ray; for choosing, one ray for each box of the drawn surface is enough. Samples that see
/// no box are left out, and so are those that add nothing to others of their point: what a finer sample shows in the
/// same direction, a coarser one needs not show. `errors`: of the proxy in each box.
std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, std::span<const ProxyError> errors,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning);

}  // namespace client
