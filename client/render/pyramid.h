#pragma once
// Mip levels of a sampling image, built on the CPU: WebGL2 can only rebuild all layers of an array at once.
#include <cstdint>
#include <vector>

#include "base/image.h"

namespace client {

/// Levels of an image of this size down to 1 × 1: 1 + floor(log2(max(width, height))).
int pyramidLevels(int width, int height);

/// Bytes of all levels of one RGBA8 image.
std::uint64_t pyramidBytes(int width, int height);

/// All levels of `rgba` (4 channels, not empty), the first of its own size, rows bottom up as GL wants them, colour
/// multiplied by alpha. Premultiplied pixels average rightly: a texel's colour divided by its alpha is the mean over
/// its covered pixels only, so no background bleeds over a silhouette, neither from mip levels nor from bilinear
/// filtering.
std::vector<base::Image> premultipliedPyramid(const base::Image& rgba);

}  // namespace client
