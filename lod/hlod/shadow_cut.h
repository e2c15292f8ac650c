#pragma once
// Chooses for a light the views from it in which shadow maps are drawn, and the nodes that cast shadows there (Guthe et
// al. 2004, section 4.1).
//
// Receivers, the nodes that a view draws, are divided by their level of the octree, whose errors are alike. The box of
// each level's receivers gives a view of the light's own. A caster may be as coarse as its shadow's edge allows where
// it falls on these receivers.
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/camera.h"
#include "lod/hlod/format.h"
#include "lod/hlod/traverse.h"

namespace lod::hlod {

/// A light, scene-local.
struct ShadowLight {
  /// A place with w = 1, or with w = 0 the unit direction towards a light that is infinitely far.
  glm::vec4 place{0.0F, 0.0F, 1.0F, 0.0F};
  /// Diameter of its disc: scene units, or radians as seen from the scene where it is infinitely far. 0: hard shadows.
  float size = 0.0F;
  friend bool operator==(const ShadowLight&, const ShadowLight&) = default;
};

/// The most that a caster may be off, scene units: ε_c = (ε_r d_l + γ s_l d_p) / (d_l + d_p), section 4.1, or
/// ε_r + γ s_l d_p for a light that is infinitely far. `receiver`: ε_r. `change`: γ, of the light's intensity, 0 … 1.
/// `to_light`: d_l, the caster's distance from the light; not used for a light that is infinitely far. `to_receiver`:
/// d_p. ε_r where the caster touches both.
float casterError(const ShadowLight& light, float receiver, float change, float to_light, float to_receiver);

/// A part of what a view draws, on which shadows may fall.
struct ShadowReceiver {
  base::Aabb box;
  /// Those of one level share maps; from the coarsest, or farthest, on. Maps are small where the boxes of a level are
  /// alike in the size that they have on the screen.
  std::uint32_t level = 0;
};

struct ShadowRequest {
  TraverseRequest view;  ///< that of the receivers; what its section cuts away casts no shadows
  ShadowLight light;
  float intensity_change = 0.05F;   ///< γ; counts for lights of some size
  float texel_px = 0.5F;            ///< a texel of a shadow map covers at most so many of the view's pixels, where
  std::uint32_t max_texels = 4096;  ///< … this many a side allow it
  /// Neighbouring levels share maps, those first that take the fewest texels more; or what has texels over four times
  /// as large as wanted is divided by its distance from the eye. A light near receivers sees them in up to six maps,
  /// even where that is more than this.
  std::size_t max_maps = 4;
  /// Maps reach so much farther on each side than the view sees, as a share of the size of what it sees, and are as
  /// fine as a view needs that is nearer by as much. They hold for views near this one, then.
  float room = 0.0F;
};

/// A view from the light.
struct ShadowMapPlan {
  base::Camera camera;  ///< parallel or perspective; width and height are those of the map, texels
  /// Places in the list of receivers, rising. The maps of a light near receivers share some, of which each shows a
  /// part, and so do slices of a view, of which the first that holds a place is for it.
  std::vector<std::uint32_t> receivers;
  std::vector<std::uint32_t> casters;  ///< nodes, rising
  float texel_px = 0.0F;               ///< the largest size of a texel where receivers lie, pixels of the view
  /// ε_r, scene units: the error that the view tolerates at the nearest of the receivers. Casters in their box are off
  /// by at most so much.
  float receiver_error = 0.0F;
  base::Aabb region;  ///< scene-local; holds all of the receivers that is seen, and the room around them
  /// The map is for places p of its receivers with dot(plane, (p, 1)) >= 0 for both planes, a slice of the view.
  std::array<glm::dvec4, 2> slice{kNoEnd, kNoEnd};
  static constexpr glm::dvec4 kNoEnd{0.0, 0.0, 0.0, 1.0};
};

/// Nodes as receivers.
std::vector<ShadowReceiver> receiversOf(std::span<const Node> nodes, std::span<const std::uint32_t> drawn);

/// `receivers`: what the view draws; those outside of its picture are in no plan. Casters form a cut: no node
/// and one below it. Nothing for cameras and lights with NaN or infinity in them.
///
/// Any edge of a hard shadow on a receiver that faces the light is off by ε_r at most. For that d_l and d_p are, of
/// those of all places of caster and receivers, the ones that allow least; the paper takes the nearest receiver's.
std::vector<ShadowMapPlan> planShadowMaps(std::span<const Node> nodes, std::span<const ShadowReceiver> receivers,
                                          const ShadowRequest& request);
/// The same for nodes that the view draws.
inline std::vector<ShadowMapPlan> planShadowMaps(std::span<const Node> nodes, std::span<const std::uint32_t> drawn,
                                                 const ShadowRequest& request) {
  return planShadowMaps(nodes, receiversOf(nodes, drawn), request);
}

/// The largest number of the view's pixels that a scene unit covers anywhere in the box; 0 where it is not seen.
double largestScale(const TraverseRequest& view, const base::Aabb& box);

/// A map of the whole scene, for views in which a scene unit covers at most so many pixels anywhere. It depends on no
/// view: of `request.view` the tolerance and the section count, and max_maps and room do not. Its receivers are empty.
/// None where texels would have to be larger than wanted, or for a light that sees the scene in several maps.
std::optional<ShadowMapPlan> planSceneShadowMap(std::span<const Node> nodes, double pixels_per_unit,
                                                const ShadowRequest& request);

/// Plans for one view after another. While the light stands still most views are served by the maps of one before, so
/// that whoever draws a plan's map when its camera or its casters change seldom has to.
class ShadowPlanner {
 public:
  ShadowPlanner();
  ~ShadowPlanner();

  /// As planShadowMaps(), with the fewest maps, up to request.max_maps, whose texels are at most twice as large as
  /// wanted, or four times where that takes more than four maps. The maps of the last call with the receivers of this
  /// one where all of these lie in the maps' room, and where casters and texels are as fine as they need. `nodes`:
  /// those of one file in all calls.
  std::vector<ShadowMapPlan> plan(std::span<const Node> nodes, std::span<const ShadowReceiver> receivers,
                                  const ShadowRequest& request);

 private:
  struct Kept;
  std::unique_ptr<Kept> kept_;
};

}  // namespace lod::hlod
