#pragma once
// The layout and the colours of the generated house front. x runs to the right, y up, and the wall is at z = 0.
#include <vector>

#include "mesh/generate/lettering.h"

namespace mesh::generate {

inline constexpr glm::dvec2 kFacadeSize{20.0, 12.0};  // metres
inline constexpr double kSurround = 0.18;             // metres: the width of the frame of stone around an opening
inline constexpr double kSillHeight = 0.14;
inline constexpr double kSillReach = 0.28;  // metres that a sill is wider than its opening, on each side

/// A window or the door.
struct Opening {
  glm::dvec2 low, high;
  double depth;  ///< metres from the wall back to the panes
  bool door = false;
  bool first = false;  ///< among the three that are set back in the coarsest meshes, too; others are painted there
};
/// Five in each of three storeys, from the left and from below.
const std::vector<Opening>& facadeOpenings();
/// The one of a point's bay and storey.
const Opening& openingNear(const glm::dvec2& p);

class FacadePaint : public SurfacePaint {
 public:
  explicit FacadePaint(std::uint64_t seed);
  const std::vector<Sign>& signs() const override { return lettering_.signs(); }
  glm::dvec3 colorAt(const glm::dvec3& point, double texel) const override;

  const Lettering& lettering() const { return lettering_; }
  /// The wall, and the panes in the openings.
  glm::dvec3 front(const glm::dvec2& p, double texel) const;
  /// The wall as if there were no panes.
  glm::dvec3 wall(const glm::dvec2& p, double texel) const;
  glm::dvec3 pane(const Opening& opening, const glm::dvec2& p, double texel) const;
  /// A side of an opening, at `along` metres from its beginning: 0 is below, and on counterclockwise. `inward` runs
  /// from 0 at the wall to 1 at the panes.
  glm::dvec3 reveal(int side, double along, double inward, double texel) const;

 private:
  void letter();
  glm::dvec3 worn(const glm::dvec3& color, const glm::dvec2& p, double texel) const;
  glm::dvec3 masonry(const glm::dvec2& p, double texel) const;
  glm::dvec3 bricks(const glm::dvec2& p, double texel) const;
  glm::dvec3 blocks(const glm::dvec2& p, const glm::dvec2& size, const glm::dvec3& color, double texel) const;
  glm::dvec3 trims(const glm::dvec3& wall, const glm::dvec2& p, double texel) const;
  glm::dvec3 surround(const glm::dvec3& wall, const Opening& opening, const glm::dvec2& p, double texel) const;
  glm::dvec3 window(const Opening& opening, const glm::dvec2& p, double texel) const;
  glm::dvec3 glass(const Opening& opening, const glm::dvec2& q, double texel) const;
  glm::dvec3 door(const Opening& opening, const glm::dvec2& p, double texel) const;
  double noise(const glm::dvec2& p, double wavelength, double texel, std::uint32_t salt) const;

  std::uint32_t seed_;
  Lettering lettering_;
};

}  // namespace mesh::generate
