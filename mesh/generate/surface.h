#pragma once
// The surfaces that sample.h generates consist of rows of vertices and bands of triangles between them, and each row
// and band can be computed on its own.
//
// The numbers are the same on any machine: these files use only + − × ÷ and sqrt on doubles, whose results IEEE 754
// fixes, are compiled without fused multiply-add, and use no libm and no std:: distributions.
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <vector>

#include "mesh/generate/sample.h"

namespace mesh::generate {

struct SamplePoint {
  glm::dvec3 position;
  glm::u8vec4 color;
};

class SampleSurface {
 public:
  virtual ~SampleSurface() = default;
  virtual std::uint64_t rowCount() const = 0;
  virtual std::uint64_t rowSize(std::uint64_t row) const = 0;
  virtual SamplePoint point(std::uint64_t row, std::uint64_t column) const = 0;
  /// Appends the triangles between `row` and `row + 1`, whose vertices are numbered from `upper_start` and
  /// `lower_start` on.
  virtual void band(std::uint64_t row, std::uint32_t upper_start, std::uint32_t lower_start,
                    std::vector<std::uint32_t>& corners) const = 0;
  virtual std::uint64_t triangleCount() const = 0;
  std::uint64_t vertexCount() const;
};

std::unique_ptr<SampleSurface> makeStatue(std::uint64_t triangles, std::uint64_t seed);
std::unique_ptr<SampleSurface> makeRelief(std::uint64_t triangles, std::uint64_t seed);

// ---- Functions that both surfaces use ----

std::uint32_t latticeHash(std::int64_t x, std::int64_t y, std::int64_t z, std::uint32_t seed);
/// Value noise on the integer lattice with quintic blending, in [−1, 1], with mean 0 and about one bump per unit
/// length.
double valueNoise(const glm::dvec3& p, std::uint32_t seed);
/// The same in the plane, in about half of the time.
double valueNoise(const glm::dvec2& p, std::uint32_t seed);
/// floor(), for values within 63 bits.
std::int64_t floorToInt(double x);
/// sin(x · 90°) for x in [0, 1]; absolute error below 1e-9.
double sinQuarter(double x);
/// A wave of period 1 made of parabolas: 0 at 0, 1 at 0.25, −1 at 0.75.
double wave(double x);
/// Rises smoothly from 0 at a to 1 at b.
double smooth(double a, double b, double x);
/// 1 where edges of this length resolve a detail of this wavelength well, 0 where it would alias.
double resolved(double wavelength, double edge);

/// The roughness and colour of weathered stone. `cavity` runs from −1 in deep carving to 1 on ridges.
class Weathering {
 public:
  Weathering(double edge, std::uint32_t seed) : edge_(edge), seed_(seed) {}
  /// Fractal roughness and pits, in scene units, down to a wavelength of about three edges. `fine` gets the finest
  /// octaves' share, in [−1, 1].
  double roughness(const glm::dvec3& p, double& fine) const;
  glm::u8vec4 color(const glm::dvec3& p, double cavity, double fine) const;

 private:
  double edge_;
  std::uint32_t seed_;
};

}  // namespace mesh::generate
