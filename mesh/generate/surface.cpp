#include "mesh/generate/surface.h"

#include <algorithm>

namespace mesh::generate {

std::uint64_t SampleSurface::vertexCount() const {
  std::uint64_t count = 0;
  for (std::uint64_t row = 0; row < rowCount(); ++row) count += rowSize(row);
  return count;
}

// The multipliers are large odd numbers; the finalizer is "lowbias32" (Wellons 2018).
std::uint32_t latticeHash(std::int64_t x, std::int64_t y, std::int64_t z, std::uint32_t seed) {
  std::uint32_t h = static_cast<std::uint32_t>(x) * 0x8DA6B343U + static_cast<std::uint32_t>(y) * 0xD8163841U +
                    static_cast<std::uint32_t>(z) * 0xCB1AB31FU + seed;
  h = (h ^ (h >> 16U)) * 0x7FEB352DU;
  h = (h ^ (h >> 15U)) * 0x846CA68BU;
  return h ^ (h >> 16U);
}

// Truncates and corrects negatives: the same as floor(), without a call.
std::int64_t floorToInt(double x) {
  const auto i = static_cast<std::int64_t>(x);
  return static_cast<double>(i) > x ? i - 1 : i;
}

namespace {

double quintic(double t) {
  return t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
}
double mixed(double a, double b, double t) {
  return a + (b - a) * t;
}

double corner(std::int64_t x, std::int64_t y, std::int64_t z, std::uint32_t seed) {
  return static_cast<double>(latticeHash(x, y, z, seed)) * (2.0 / 4294967295.0) - 1.0;
}

// A rotation with rational entries. Octaves that are turned against each other hide the lattice.
glm::dvec3 turned(const glm::dvec3& p) {
  return {0.8 * p.y + 0.6 * p.z, -0.8 * p.x + 0.36 * p.y - 0.48 * p.z, -0.6 * p.x - 0.48 * p.y + 0.64 * p.z};
}

// Three cells of a lattice in four hold a round pit, 1 at its centre and 0 outside, which stays within its cell.
double pitIn(const glm::dvec3& p, std::uint32_t seed) {
  const std::int64_t x = floorToInt(p.x);
  const std::int64_t y = floorToInt(p.y);
  const std::int64_t z = floorToInt(p.z);
  const std::uint32_t h = latticeHash(x, y, z, seed);
  if ((h & 3U) == 0U) return 0.0;
  const auto part = [h](std::uint32_t shift) { return static_cast<double>((h >> shift) & 255U) / 255.0; };
  const double radius = 0.12 + 0.26 * part(2) * part(2);
  const glm::dvec3 center(radius + (1.0 - 2.0 * radius) * part(8), radius + (1.0 - 2.0 * radius) * part(16),
                          radius + (1.0 - 2.0 * radius) * part(24));
  const glm::dvec3 d = p - glm::dvec3(static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)) - center;
  return smooth(radius, 0.4 * radius, glm::length(d));
}

}  // namespace

double valueNoise(const glm::dvec3& p, std::uint32_t seed) {
  const std::int64_t x = floorToInt(p.x);
  const std::int64_t y = floorToInt(p.y);
  const std::int64_t z = floorToInt(p.z);
  const double u = quintic(p.x - static_cast<double>(x));
  const double v = quintic(p.y - static_cast<double>(y));
  const double w = quintic(p.z - static_cast<double>(z));
  const double near = mixed(mixed(corner(x, y, z, seed), corner(x + 1, y, z, seed), u),
                            mixed(corner(x, y + 1, z, seed), corner(x + 1, y + 1, z, seed), u), v);
  const double far = mixed(mixed(corner(x, y, z + 1, seed), corner(x + 1, y, z + 1, seed), u),
                           mixed(corner(x, y + 1, z + 1, seed), corner(x + 1, y + 1, z + 1, seed), u), v);
  return mixed(near, far, w);
}

double valueNoise(const glm::dvec2& p, std::uint32_t seed) {
  const std::int64_t x = floorToInt(p.x);
  const std::int64_t y = floorToInt(p.y);
  const double u = quintic(p.x - static_cast<double>(x));
  const double v = quintic(p.y - static_cast<double>(y));
  return mixed(mixed(corner(x, y, 0, seed), corner(x + 1, y, 0, seed), u),
               mixed(corner(x, y + 1, 0, seed), corner(x + 1, y + 1, 0, seed), u), v);
}

double sinQuarter(double x) {
  // The Taylor series of sin to the 13th power.
  const double a = x * 1.5707963267948966;
  const double q = a * a;
  return a * (1.0 -
              q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0 * (1.0 - q / 156.0))))));
}

double wave(double x) {
  const double t = x - static_cast<double>(floorToInt(x));
  return t < 0.5 ? 16.0 * t * (0.5 - t) : -16.0 * (t - 0.5) * (1.0 - t);
}

double smooth(double a, double b, double x) {
  const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

double resolved(double wavelength, double edge) {
  return std::clamp(0.5 * (wavelength / edge - 2.0), 0.0, 1.0);
}

double Weathering::roughness(const glm::dvec3& p, double& fine) const {
  // The amplitude falls with the wavelength, so that every scale has about the same share of the slope.
  double height = 0.0;
  double wavelength = 0.22;
  double amplitude = 0.010;
  glm::dvec3 q = turned(p) * (1.0 / wavelength);
  fine = 0.0;
  for (std::uint32_t octave = 0; octave < 16; ++octave) {
    const double seen = resolved(wavelength, edge_);
    if (seen <= 0.0) break;
    const double n = valueNoise(q, seed_ + octave);
    height += seen * amplitude * n;
    fine = 0.55 * fine + 0.45 * n;
    q = turned(q) * 2.03;
    wavelength /= 2.03;
    amplitude *= 0.53;
  }

  // Rain has left pits, in patches.
  const glm::dvec3 t = turned(p);
  const double where = smooth(-0.2, 0.4, valueNoise(t * 3.1, seed_ + 103U));
  const double pit = where * (pitIn(t * 24.0, seed_ + 101U) * resolved(0.02, edge_) +
                              0.4 * pitIn(t * 67.0, seed_ + 107U) * resolved(0.007, edge_));
  height -= 0.005 * pit;
  fine = std::clamp(fine - 0.6 * pit, -1.0, 1.0);
  return height;
}

glm::u8vec4 Weathering::color(const glm::dvec3& p, double cavity, double fine) const {
  // The stone has strata, dirt in carvings and cavities, and polished ridges.
  const double strata = wave(p.y * 6.0 + 0.7 * valueNoise(p * 1.7, seed_ + 211U));
  glm::dvec3 c = glm::dvec3(176.0, 164.0, 143.0) + strata * glm::dvec3(13.0, 10.0, 4.0);
  const double light = std::clamp(0.78 + 0.22 * cavity + 0.22 * fine, 0.3, 1.25);
  c *= light;

  // Water has left dark streaks.
  const double streak = smooth(0.25, 0.75, valueNoise(glm::dvec3(p.x * 15.0, p.y * 1.3, p.z * 15.0), seed_ + 223U));
  c *= 1.0 - 0.35 * streak;

  // Lichen grows in ochre or grey-green patches with ragged rims.
  const glm::dvec3 t = turned(p);
  const double patch =
      valueNoise(t * 4.3, seed_ + 227U) + 0.4 * valueNoise(turned(t) * 13.0, seed_ + 233U) + 0.35 * fine;
  const double lichen = smooth(0.42, 0.58, patch);
  const double kind = smooth(-0.2, 0.2, valueNoise(t * 2.1, seed_ + 229U));
  const glm::dvec3 growth = glm::dvec3(186.0, 142.0, 62.0) * kind + glm::dvec3(128.0, 138.0, 104.0) * (1.0 - kind);
  c = c * (1.0 - 0.75 * lichen) + growth * (0.75 * lichen * (0.9 + 0.2 * fine));

  const auto byte = [](double v) { return static_cast<std::uint8_t>(std::clamp(v + 0.5, 0.0, 255.0)); };
  return {byte(c.r), byte(c.g), byte(c.b), 255};
}

}  // namespace mesh::generate
