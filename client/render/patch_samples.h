#pragma once
// Decides which samples the shader tries at each patch of the proxy. No GL.
#include <cstdint>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/geometry.h"
#include "client/render/lumigraph.h"
#include "client/render/sample_geometry.h"

namespace client {

/// Returns for each box the samples whose cores it may lie in, as ascending indices: those of at most `max_points`
/// points, the ones that weigh most there. `points`: the point of each sample; those of one point stand together.
/// `errors`: of the proxy in each box.
std::vector<std::vector<std::uint32_t>> samplesOfPatches(std::span<const SampleGeometry* const> samples,
                                                         std::span<const std::uint32_t> points,
                                                         std::span<const base::Aabb> boxes,
                                                         std::span<const ProxyError> errors, const base::Camera& view,
                                                         std::size_t max_points, const BlendTuning& tuning);

}  // namespace client
