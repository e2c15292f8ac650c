#pragma once
// Builds the mip levels of a sampling image on the CPU: WebGL2 can only rebuild all layers of an array at once.
#include <cstdint>
#include <vector>

#include "base/image.h"

namespace client {

/// Returns the number of levels of an image of this size down to 1 × 1: 1 + floor(log2(max(width, height))).
int pyramidLevels(int width, int height);

/// Returns the bytes of all levels of an RGBA8 image.
std::uint64_t pyramidBytes(int width, int height);

/// Returns all levels of `rgba` (4 channels, not empty), from its own size on, rows bottom up as GL wants them, colour
/// multiplied by alpha. Premultiplied pixels average correctly: a texel's colour divided by its alpha is the mean over
/// its covered pixels only, so no background bleeds over a silhouette, neither from mip levels nor from bilinear
/// filtering.
std::vector<base::Image> premultipliedPyramid(const base::Image& rgba);

}  // namespace client
