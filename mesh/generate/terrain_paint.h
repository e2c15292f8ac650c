#pragma once
// The layout, the heights and the colours of the generated terrain. x runs east, y north and z up.
#include <vector>

#include "mesh/generate/lettering.h"

namespace mesh::generate {

inline constexpr glm::dvec2 kTerrainSize{200.0, 200.0};  // metres

class TerrainPaint : public SurfacePaint {
 public:
  explicit TerrainPaint(std::uint64_t seed);
  const std::vector<Sign>& signs() const override { return lettering_.signs(); }
  glm::dvec3 colorAt(const glm::dvec3& point, double texel) const override { return ground({point.x, point.y}, texel); }

  glm::dvec3 ground(const glm::dvec2& p, double texel) const;
  /// Metres, with as much roughness as edges of this length resolve. Roads are even across, signs lie flat.
  double height(const glm::dvec2& p, double edge) const;

 private:
  /// Where a point lies beside a road, in metres.
  struct RoadPlace {
    double along = 0.0;
    double aside = 1e9;      // from the middle line, not negative
    glm::dvec2 middle{0.0};  // the point of the middle line at the same x, or the same y
  };
  RoadPlace alongFirst(const glm::dvec2& p) const;
  RoadPlace alongSecond(const glm::dvec2& p) const;
  void letter();
  void shadeHills();
  double hills(const glm::dvec2& p) const;
  double noise(const glm::dvec2& p, double wavelength, double texel, std::uint32_t salt) const;
  glm::dvec2 slopeAndLight(const glm::dvec2& p) const;
  glm::dvec3 meadow(const glm::dvec2& p, double texel) const;
  /// A kind of plant: how far apart, how large in metres, and how rare.
  struct Plant {
    double cell, min_radius, max_radius, rarity;
  };
  glm::dvec3 withPlant(const glm::dvec3& color, const Plant& plant, const glm::dvec2& p, double texel) const;
  glm::dvec3 withTrees(const glm::dvec3& color, const glm::dvec2& p, double texel) const;
  glm::dvec3 road(const glm::dvec3& color, const RoadPlace& place, const glm::dvec2& p, double markings,
                  double texel) const;

  std::uint32_t seed_;
  double phase_ = 0.0;
  Lettering lettering_;
  std::vector<glm::dvec2> slope_and_light_;  // a table over the terrain
};

}  // namespace mesh::generate
