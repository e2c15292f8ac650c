#pragma once
// Chooses the tiles of faces (repository/sampling/tile.h) that serve a view best: those that lessen its expected
// squared error most. The functions are pure.
//
// The error that a viewer's blend is expected to have at a piece of surface follows client/render's shader
// (blend_fragment.glsl), which weighs images by it. Of the proxy's own shading it is the typical error of its colours,
// c². Of an image it is
//
// clang-format off
//   e² = n² + (c / b)² · (3 t² − 1 + s²)
//   n    error of an image's coding
//   b    blur of the proxy's shading, in view pixels: its mean edge
//   t    view pixels that a texel covers, more where the image sees the surface at a slant; at least 1
//   s    view pixels by which the proxy's typical error shifts the image: 3 · error · angle between the rays
// clang-format on
//
// One image may fail at a place: something thin hides it, or its coverage is wrong. So a place's error is
// (1 − q) · e1² + q · e2², with e1 of the best image and e2 of the best one from another point, or of the proxy.
#include <cstddef>
#include <functional>
#include <span>
#include <vector>

#include "plan/point_choice.h"
#include "repository/sampling/key.h"

namespace plan {

/// How the proxy shows a piece of surface by itself.
struct ProxyShading {
  float color_error = 0.1F;  ///< typical, 0..1
  float edge = 0.0F;         ///< scene units: mean length of its triangles' edges
  float shape_error = 0.0F;  ///< scene units, typical
};

struct TileQuery {
  PointQuery points;
  std::size_t max_tiles = 64;
  /// Whether a tile is known not to be stored. Its nearest ancestor then shows as much as it would.
  std::function<bool(const repository::FaceKey&)> is_absent = [](const repository::FaceKey&) { return false; };
  /// Whether the viewer has a tile already, so that others gain only what they add to it.
  std::function<bool(const repository::FaceKey&)> is_here = [](const repository::FaceKey&) { return false; };
};

/// A tile, and by how much it lessens the squared error of the picture's colours (0..1, mean over the picture) after
/// those before it.
struct ChosenTile {
  repository::FaceKey key;
  float gain = 0.0F;
};

/// Tiles of these points that are not here, the most gain first, until none gains anything worth its bytes. `proxies`:
/// one a sample.
std::vector<ChosenTile> chooseTiles(const TileQuery& query, std::span<const glm::uvec3> points,
                                    std::span<const SurfaceSample> samples, std::span<const ProxyShading> proxies);

}  // namespace plan
