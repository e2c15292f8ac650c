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

/// The cells into which a patch's box is divided, so that a pixel tries only the samples that may see its part of it.
struct PatchCells {
  glm::vec3 begin{0.0F};                          ///< the box's lower corner
  glm::vec3 per_unit{0.0F};                       ///< cells per scene unit along each axis
  glm::ivec3 counts{1};                           ///< along each axis, 1..kMostCellsAcross
  std::vector<std::vector<std::uint32_t>> lists;  ///< of each cell, along x first: samples, ascending
  std::size_t samples = 0;                        ///< that may see the patch
};
inline constexpr int kMostCellsAcross = 4;

/// Divides patches by their size in the view. `lists`: the samples of each, as samplesOfPatches() has them.
std::vector<PatchCells> cellsOfPatches(const std::vector<std::vector<std::uint32_t>>& lists,
                                       std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, const base::Camera& view);

}  // namespace client
