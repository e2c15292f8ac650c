#pragma once
// Chooses the sampling images of a frame. No GL.
#include <functional>
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

/// Places that a view shows, evenly over its picture.
struct VisibleSurface {
  std::vector<glm::vec3> places;  ///< scene-local
  /// Whether nothing lies between an eye (scene-local) and a place, by its number, and it sees the side that the view
  /// does.
  std::function<bool(const glm::vec3& eye, std::size_t place)> is_seen_from;
};

/// Returns the indices of up to `limit` of `samples`, in the order of what they add to the view. Buehler et al. 2001,
/// section 3, rank cameras per ray; for choosing, one ray for each place of `surface` is enough. Boxes of the drawn
/// surface, one ray each, say less, since nothing hides them, and those of a scan with few triangles are as large as
/// rooms: what they add comes after that, or alone where there is no `surface` (null). Samples that see nothing are
/// left out, and so are those that add nothing to others of their point: what a finer sample shows in the same
/// direction, a coarser one needs not show. `errors`: of the proxy in each box. Up to `more` come after those, of the
/// points that have many among them, so that no place along the borders of their samples goes without.
std::vector<std::size_t> chooseSamples(std::span<const SampleGeometry* const> samples,
                                       std::span<const base::Aabb> boxes, std::span<const ProxyError> errors,
                                       const base::Camera& view, std::size_t limit, const BlendTuning& tuning,
                                       const VisibleSurface* surface = nullptr, std::size_t more = 0);

}  // namespace client
