#pragma once
// How far a place of a surface is from one of the same appearance on a triangle (Guthe et al. 2004, section 3.1).
//
// With q' the place of the triangle closest to p, and q the closest one with p's normal or colour, pq' and q'q are
// taken for orthogonal: ε² = ε_geo² + ε_app². ε_app is the difference of the attribute at q' divided by κ, how fast the
// attribute changes along the triangle: its steepest edge.
//
// Four triangles are measured at once, one in each lane.
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>

#include "base/simd.h"
#include "lod/patch/builder/facet_surface.h"

namespace lod::hlod::builder {

using Four = base::Float4;
using FourPoints = patch::builder::Facet::FourPoints;

/// The attributes that count, and how different they must be: smaller differences cannot be seen.
struct AppearanceOptions {
  bool normals = true;
  bool colors = true;
  float negligible_turn = 0.02F;  ///< radians between normals
  float negligible_color = 5.0F;  ///< 0 … 255 a channel, Euclidean: what storing colours may change
  bool isShapeAlone() const { return !normals && !colors; }
};

/// Vectors in their first three lanes; the fourth means nothing.
struct Attributes {
  Four position{};
  Four normal{};  ///< unit
  Four color{};   ///< 0 … 255
};

inline Four fourOf(const glm::vec3& v) {
  return Four{v.x, v.y, v.z, 0.0F};
}
inline glm::vec3 vectorOf(const Four& v) {
  return {v[0], v[1], v[2]};
}

/// The angle between unit vectors, radians. For small angles it is the length of their difference (section 3.1), which
/// is corrected here so that it holds for large ones, too.
inline float angleBetween(const glm::vec3& a, const glm::vec3& b) {
  return 2.0F * std::asin(std::fmin(0.5F * glm::length(a - b), 1.0F));
}

/// The attributes of four places.
struct FourAttributes {
  FourPoints position, normal, color;
};

/// The shapes of four triangles.
class FourTriangles {
 public:
  /// The place of each triangle that is closest to a point.
  struct Closest {
    Four b_weight{}, c_weight{};  ///< of the corners; that of a is 1 less both
    Four distance2{};             ///< units of the positions, squared
  };

  FourTriangles() = default;
  FourTriangles(const FourPoints& a, const FourPoints& b, const FourPoints& c);
  Closest closest(const Four& p) const;

 private:
  FourPoints a_, ab_, ac_;
  Four bb_{}, bc_{}, cc_{};                    // products of ab and ac
  Four ab_scale_{}, ac_scale_{}, bc_scale_{};  // 1 by the squared lengths of edges, or 0
};

/// Four triangles with their curvatures.
class FourAppearances {
 public:
  FourAppearances() = default;
  FourAppearances(const FourAttributes& a, const FourAttributes& b, const FourAttributes& c,
                  const AppearanceOptions& options);

  /// ε² of the place, in units of the positions; infinite where a triangle has no such appearance.
  Four error2(const Attributes& place, const AppearanceOptions& options) const;

 private:
  struct Slopes {
    FourPoints a, ab, ac;
    Four scale{};  // 1 by κ, in units of the positions; infinite where the attribute is the same everywhere
  };
  FourTriangles shape_;
  Slopes normal_, color_;
};

}  // namespace lod::hlod::builder
