#pragma once
// Chooses a cut: the patches to draw for a view (Okamoto 2011, section 4.2).
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "base/camera.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

struct CutRequest {
  base::Camera camera;        ///< perspective or parallel
  float near_plane = 1e-3F;   ///< smallest distance that projected errors are computed for, scene units
  float tolerance_px = 1.0F;  ///< refine while a visible group's projected error is above this; 0 gives the leaves
  base::ErrorMeasure measure = base::ErrorMeasure::kVisible;  ///< of errors, here and in the cut
  /// Stop refining (largest error first) before the visible patches exceed this; the root patch is drawn whatever it
  /// has.
  std::uint64_t max_triangles = std::numeric_limits<std::uint64_t>::max();
  /// … or before all patches that expanded groups consume, drawn or not, would cost more than this: what a client holds
  /// to draw the cut. 0 bytes of cost for each patch where `cost` is empty. Group 0 is expanded whatever it costs.
  std::uint64_t max_cost = std::numeric_limits<std::uint64_t>::max();
  std::function<std::uint64_t(const Patch&)> cost;
  /// Groups outside the frustum, or that the camera's section cuts away, are not refined, nor are such patches drawn.
  bool cull = true;
  bool cull_back_faces =
      false;  ///< patches facing away are not drawn: only for closed meshes, open scans are seen from behind too
};

struct Cut {
  std::vector<std::uint32_t> patches;  ///< to draw
  std::vector<float>
      patch_error_px;  ///< beside `patches`: projected error of each (0: a leaf); error_px is the largest
  std::vector<std::uint32_t> expanded;  ///< groups drawn through, parents first (group 0 first)
  /// Groups that should be expanded next but are not `available`, largest projected error first: what to fetch. Their
  /// parents are all expanded. Groups that a growing hierarchy doesn't know are not among them: nothing tells their
  /// error, the server does.
  std::vector<std::uint32_t> wanted;
  std::uint64_t triangles = 0;  ///< triangles of `patches`
  std::uint64_t cost = 0;       ///< cost of all patches that `expanded` consume (CutRequest::cost)
  bool limited = false;         ///< max_triangles or max_cost ended the refinement above the tolerance
  /// Largest projected error among what is drawn (0: leaves). Where a growing hierarchy doesn't know the group that
  /// made a drawn patch, the error that came with the patch is projected at its consumer's sphere: a bound.
  float error_px = 0.0F;
  float bound_px = 0.0F;              ///< the same of proved bounds, whatever the measure of the request
  float shape_px = 0.0F;              ///< and of shape
  std::vector<float> patch_bound_px;  ///< beside `patches`
};

/// Refines by largest projected error. A group is expanded only when all its parents are and `available(group)` says
/// that all of its consumed patches are here (null: all are); so the cut is watertight whatever is missing. `available`
/// is asked about known groups only, each at most once. Time: about that of visiting the expanded groups' patches, plus
/// clearing 16 bytes per group.
Cut selectCut(const Hierarchy& hierarchy, const CutRequest& request,
              const std::function<bool(std::uint32_t)>& available = nullptr);

/// The cut whose every patch has a stated error ≤ `world_error` (and is the coarsest such), without any view: error_px
/// stays 0. Unknown groups of a growing hierarchy are not expanded.
Cut selectUniformCut(const Hierarchy& hierarchy, float world_error);

/// The cut that draws through the given groups, one flag per group. Group 0 is among them, and with each group all its
/// parents. error_px stays 0.
Cut cutOfExpanded(const Hierarchy& hierarchy, const std::vector<std::uint8_t>& expanded);

struct UniformCut {
  Cut cut;
  float error = 0.0F;  ///< scene units: the largest stated error in it
};
/// The finest of these cuts that has at most `max_triangles`; where none has, the coarsest.
UniformCut selectFinestUniformCut(const Hierarchy& hierarchy, std::uint64_t max_triangles);

}  // namespace lod::patch
