#pragma once
// Decides how the weights of samples end at the borders of their cores, so that neighbours of one point meet without a
// seam. No GL.
#include <span>
#include <vector>

#include "client/render/sample_geometry.h"

namespace client {

/// Components stand for the left, right, bottom and top side, as in shaders/blend_samples.glsl.
struct SampleBorders {
  /// Share of its weight that the sample keeps at that side, 0 … 1; with 0 it fades out.
  glm::vec4 floors{0.0F};
  /// Above 0: a coarser sample goes on there, and at the side this one counts as coarse as that, by so many doublings.
  /// Below 0: a coarser sample of the point lies under this one and goes on beyond the side, so that this one fades out
  /// over it; −1 to −0, by that sample's fade in time.
  glm::vec4 beyond{0.0F};
  float under = 0.0F;  ///< fade in time, 0 … 1, of the coarser samples of the point that show all of this one's core
};

/// Returns the borders of each sample, given those that are drawn together and their fades in time (0 … 1). Where
/// another has the same centre and its side lies at the same place (the next face of a cube, the next tile), nothing
/// has to fade, since the other continues there; beside one that is still fading in, the weight sinks to the other's.
std::vector<SampleBorders> bordersOf(std::span<const SampleGeometry* const> samples, std::span<const float> fades,
                                     const SampleNesting& nesting);

}  // namespace client
