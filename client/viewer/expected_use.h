#pragma once
// Estimates before drawing which images a view will use most: the share of the blend that each is expected to get.
//
// The blend weighs an image at a surface point by the angle between the view ray and the sampling ray and by its
// resolution there (Okamoto 2011, section 3). Here the same weight (client/render/choose.h) is summed over a few
// *anchors*: points of the surface in view where lines of sight find it (client/viewer/surface_sight.h), else near it,
// taken from the patches of the current cut. The estimate ranks images but decides nothing.
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/camera.h"
#include "lod/patch/hierarchy.h"

namespace client {

/// A choice: more points represent the picture better, and each has to be weighed for every image.
inline constexpr std::size_t kMaxAnchors = 256;

/// Returns at most kMaxAnchors points on or near the drawn surface and inside the view; none when nothing drawn is in
/// view.
std::vector<glm::vec3> anchorsInView(const lod::patch::Hierarchy& hierarchy, std::span<const std::uint32_t> cut,
                                     const base::Camera& view);

/// Returns the expected share of the blend of each sample, 0 … 1. The shares sum to 1, or to the share of anchors that
/// any sample sees. `is_seen_from`: whether nothing lies between an eye and an anchor, by its number; empty: nothing
/// does.
std::vector<float> expectedUse(std::span<const glm::vec3> anchors, const base::Camera& view,
                               std::span<const base::Camera* const> samples,
                               const std::function<bool(const glm::vec3& eye, std::size_t anchor)>& is_seen_from = {});

}  // namespace client
