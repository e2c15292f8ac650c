// Generates a weathered stone bust on a plinth, closed and of genus 0. A body of smoothly joined solids gives a coarse
// table of radii around a vertical axis; each vertex interpolates it and adds carving along its own ray. As every
// vertex stays on its ray, the surface cannot fold over, whatever is carved.
#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel.h"
#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

// ---- The body ----
//
// Its parts are signed distances, negative inside. y points up, the face looks towards +z; it is about 2.1 units tall.

double ball(const glm::dvec3& p, const glm::dvec3& center, double radius) {
  return glm::length(p - center) - radius;
}

double capsule(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& b, double radius) {
  const glm::dvec3 ab = b - a;
  const double t = std::clamp(glm::dot(p - a, ab) / glm::dot(ab, ab), 0.0, 1.0);
  return glm::length(p - a - t * ab) - radius;
}

double ellipsoid(const glm::dvec3& p, const glm::dvec3& center, const glm::dvec3& radii) {
  const glm::dvec3 q = (p - center) / radii;
  const double k0 = glm::length(q);
  const double k1 = glm::length(q / radii);
  return k1 > 0.0 ? k0 * (k0 - 1.0) / k1 : -std::min({radii.x, radii.y, radii.z});
}

double roundedBox(const glm::dvec3& p, const glm::dvec3& center, const glm::dvec3& half, double rounding) {
  const glm::dvec3 q = glm::abs(p - center) - half + rounding;
  return glm::length(glm::max(q, 0.0)) + std::min(std::max({q.x, q.y, q.z}), 0.0) - rounding;
}

// The union of two solids with a fillet of about k, by a quadratic polynomial.
double join(double a, double b, double k) {
  const double h = std::max(k - std::abs(a - b), 0.0) / k;
  return std::min(a, b) - 0.25 * h * h * k;
}
double carve(double a, double b, double k) {
  return -join(-a, b, k);
}

double headDistance(const glm::dvec3& p) {
  const glm::dvec3 m(std::abs(p.x), p.y, p.z);  // the face is symmetric
  double d = ellipsoid(p, {0.0, 1.72, 0.03}, {0.235, 0.32, 0.28});
  d = join(d, ball(p, {0.0, 1.54, 0.13}, 0.135), 0.10);
  d = join(d, ball(p, {0.0, 1.475, 0.215}, 0.055), 0.06);
  d = join(d, ball(m, {0.115, 1.615, 0.185}, 0.075), 0.06);
  d = join(d, capsule(m, {0.03, 1.812, 0.275}, {0.135, 1.80, 0.225}, 0.032), 0.04);
  d = carve(d, ball(m, {0.095, 1.742, 0.335}, 0.068), 0.05);
  d = join(d, ball(m, {0.092, 1.742, 0.232}, 0.047), 0.012);
  d = join(d, capsule(p, {0.0, 1.775, 0.285}, {0.0, 1.655, 0.345}, 0.030), 0.035);
  d = join(d, ball(m, {0.026, 1.645, 0.322}, 0.024), 0.02);
  d = join(d, capsule(m, {0.0, 1.577, 0.272}, {0.052, 1.572, 0.246}, 0.020), 0.015);
  d = join(d, capsule(m, {0.0, 1.548, 0.268}, {0.042, 1.55, 0.246}, 0.021), 0.015);
  d = join(d, ellipsoid(m, {0.238, 1.70, 0.0}, {0.032, 0.085, 0.055}), 0.02);
  d = join(d, ellipsoid(p, {0.0, 1.83, -0.06}, {0.272, 0.27, 0.285}), 0.025);  // hair
  d = join(d, ball(p, {0.0, 1.79, -0.30}, 0.125), 0.10);                       // knot of hair
  return d;
}

double bodyDistance(const glm::dvec3& p) {
  const glm::dvec3 m(std::abs(p.x), p.y, p.z);
  double d = ellipsoid(p, {0.0, 0.78, -0.01}, {0.43, 0.42, 0.27});
  d = join(d, capsule(m, {0.0, 1.02, -0.03}, {0.42, 0.97, -0.03}, 0.155), 0.12);
  d = join(d, capsule(m, {0.45, 0.93, -0.02}, {0.22, 0.48, 0.0}, 0.14), 0.09);  // cut arms, running into the foot
  d = join(d, ellipsoid(m, {0.17, 0.86, 0.17}, {0.17, 0.14, 0.13}), 0.10);
  d = join(d, capsule(p, {0.0, 0.28, 0.0}, {0.0, 0.55, 0.0}, 0.235), 0.15);
  d = join(d, capsule(p, {0.0, 1.05, -0.03}, {0.0, 1.5, 0.02}, 0.125), 0.11);
  d = join(d, headDistance(p), 0.06);
  d = join(d, roundedBox(p, {0.0, 0.15, 0.0}, {0.42, 0.15, 0.36}, 0.035), 0.05);
  d = join(d, roundedBox(p, {0.0, 0.05, 0.0}, {0.48, 0.05, 0.42}, 0.02), 0.02);
  return d;
}

// ---- Rays ----
//
// They start on a segment of the axis, horizontally along it, and fan out over its ends like the normals of a capsule.

constexpr double kAxisTop = 1.74;
constexpr double kAxisBottom = 0.16;
constexpr double kCapShare = 0.14;  // each fan's share of the parameter q, which runs from 0 (top) to 1 (bottom)

struct Ray {
  glm::dvec3 origin;
  glm::dvec3 direction;
};

Ray rayAt(double q, const glm::dvec2& around) {
  if (q < kCapShare || q > 1.0 - kCapShare) {
    const bool top = q < kCapShare;
    const double x = std::clamp((top ? q : 1.0 - q) / kCapShare, 0.0, 1.0);  // 0 at the pole
    const double level = sinQuarter(x);
    const double upright = top ? sinQuarter(1.0 - x) : -sinQuarter(1.0 - x);
    return {{0.0, top ? kAxisTop : kAxisBottom, 0.0}, {level * around.x, upright, level * around.y}};
  }
  const double t = (q - kCapShare) / (1.0 - 2.0 * kCapShare);
  return {{0.0, kAxisTop + (kAxisBottom - kAxisTop) * t, 0.0}, {around.x, 0.0, around.y}};
}

// Sphere tracing from the inside finds the surface, since the body surrounds the axis.
double radiusAlong(const Ray& ray) {
  double t = 0.0;
  for (int i = 0; i < 48; ++i) {
    const double d = bodyDistance(ray.origin + t * ray.direction);
    t = std::clamp(t - 0.9 * d, 0.02, 2.0);
    if (std::abs(d) < 1e-5) break;
  }
  return t;
}

// The direction in the x-z plane after some turns, where 1 is all around.
glm::dvec2 directionFromTurn(double turn) {
  const double quarters = 4.0 * turn;
  const int quadrant = std::clamp(static_cast<int>(quarters), 0, 3);
  const double x = quarters - quadrant;
  const double s = sinQuarter(x);
  const double c = sinQuarter(1.0 - x);
  constexpr std::array<std::array<int, 4>, 4> kSigns{{{1, 0, 0, 1}, {0, -1, 1, 0}, {-1, 0, 0, -1}, {0, 1, -1, 0}}};
  const auto& g = kSigns[static_cast<std::size_t>(quadrant)];
  return {g[0] * c + g[1] * s, g[2] * c + g[3] * s};
}

// ---- The table ----

// The table holds radii over (s, turn). s is the share of the mean arc length from the top pole to the bottom one, so
// that equal steps of s are about equal lengths on the body.
class RadiusTable {
 public:
  RadiusTable() {
    spaceByArcLength();
    radius_.resize(std::size_t{kRows} * kColumns);
    base::parallelFor(kRows, 0, [&](std::size_t row) {
      const double q = qAt(static_cast<double>(row) / (kRows - 1));
      for (std::size_t column = 0; column < kColumns; ++column)
        radius_[row * kColumns + column] =
            radiusAlong(rayAt(q, directionFromTurn(static_cast<double>(column) / kColumns)));
    });
  }

  double qAt(double s) const {
    const double x = std::clamp(s, 0.0, 1.0) * (kKnots - 1);
    const std::size_t i = std::min(static_cast<std::size_t>(x), std::size_t{kKnots - 2});
    return q_of_s_[i] + (q_of_s_[i + 1] - q_of_s_[i]) * (x - static_cast<double>(i));
  }

  /// Interpolates by Catmull-Rom in both directions, wrapping around the axis and ending at the poles.
  double radius(double s, double turn) const {
    const double y = std::clamp(s, 0.0, 1.0) * (kRows - 1);
    const double x = turn * kColumns;
    const int row = std::min(static_cast<int>(y), kRows - 2);
    const int column = static_cast<int>(x);
    const std::array<double, 4> wy = catmullRom(y - row);
    const std::array<double, 4> wx = catmullRom(x - column);
    double sum = 0.0;
    for (int j = 0; j < 4; ++j) {
      const double* line = radius_.data() + static_cast<std::size_t>(std::clamp(row + j - 1, 0, kRows - 1)) * kColumns;
      double across = 0.0;
      for (int i = 0; i < 4; ++i)
        across +=
            wx[static_cast<std::size_t>(i)] * line[static_cast<std::size_t>((column + i - 1 + kColumns) % kColumns)];
      sum += wy[static_cast<std::size_t>(j)] * across;
    }
    return sum;
  }

 private:
  static constexpr int kRows = 384;
  static constexpr int kColumns = 512;
  static constexpr int kKnots = 513;

  static std::array<double, 4> catmullRom(double t) {
    return {0.5 * t * (t * (2.0 - t) - 1.0), 0.5 * (t * t * (3.0 * t - 5.0) + 2.0),
            0.5 * t * (t * (4.0 - 3.0 * t) + 1.0), 0.5 * t * t * (t - 1.0)};
  }

  void spaceByArcLength() {
    // The lengths of the meridians' pieces are averaged around the axis.
    constexpr int kMeridians = 24;
    constexpr int kPieces = 1024;
    std::vector<double> length(kPieces + 1, 0.0);
    for (int m = 0; m < kMeridians; ++m) {
      const glm::dvec2 around = directionFromTurn((m + 0.5) / kMeridians);
      glm::dvec3 before(0.0);
      for (int i = 0; i <= kPieces; ++i) {
        const Ray ray = rayAt(static_cast<double>(i) / kPieces, around);
        const glm::dvec3 p = ray.origin + radiusAlong(ray) * ray.direction;
        if (i > 0) length[static_cast<std::size_t>(i)] += glm::length(p - before);
        before = p;
      }
    }
    for (std::size_t i = 1; i < length.size(); ++i) length[i] += length[i - 1];

    // The inverse gives q for equal shares of the length.
    q_of_s_.resize(kKnots);
    std::size_t piece = 1;
    for (std::size_t k = 0; k < kKnots; ++k) {
      const double wanted = length.back() * static_cast<double>(k) / (kKnots - 1);
      while (piece < kPieces && length[piece] < wanted) ++piece;
      const double t = (wanted - length[piece - 1]) / (length[piece] - length[piece - 1]);
      q_of_s_[k] = (static_cast<double>(piece - 1) + std::clamp(t, 0.0, 1.0)) / kPieces;
    }
  }

  std::vector<double> q_of_s_;
  std::vector<double> radius_;
};

// The body is the same for every seed, so one table serves all.
const RadiusTable& radiusTable() {
  static const RadiusTable table;
  return table;
}

// ---- The mesh ----

// The mesh is an octahedron whose rings are pulled apart by a belt: ring i of the caps has 4 i vertices, and each of
// the `belt` extra rings 4 n. The caps have 8 n² triangles, the belt 8 n belt.
class Statue : public SampleSurface {
 public:
  Statue(std::uint64_t triangles, std::uint64_t seed)
      : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0x9E3779B1U), table_(radiusTable()) {
    // A ring is about 2.6 long and a meridian 3.5, so cells are square where 2 n + belt = 5.4 n.
    const auto wanted = static_cast<double>(triangles);
    n_ = std::max<std::uint64_t>(2, static_cast<std::uint64_t>(std::sqrt(wanted / (8.0 * 4.4)) + 0.5));
    const double belt = wanted / (8.0 * static_cast<double>(n_)) - static_cast<double>(n_);
    belt_ = static_cast<std::uint64_t>(std::max(0.0, belt + 0.5));
    edge_ = 3.5 / static_cast<double>(2 * n_ + belt_);
    weathering_ = std::make_unique<Weathering>(edge_, seed_);
  }

  std::uint64_t rowCount() const override { return 2 * n_ + belt_ + 1; }
  std::uint64_t rowSize(std::uint64_t row) const override { return std::max<std::uint64_t>(1, 4 * quarter(row)); }
  std::uint64_t triangleCount() const override { return 8 * n_ * (n_ + belt_); }

  SamplePoint point(std::uint64_t row, std::uint64_t column) const override {
    const std::uint64_t ring = 4 * quarter(row);
    const double s = static_cast<double>(row) / static_cast<double>(rowCount() - 1);
    const double turn = ring == 0 ? 0.0 : static_cast<double>(column) / static_cast<double>(ring);
    const Ray ray = rayAt(table_.qAt(s), directionFromTurn(turn));
    const double radius = table_.radius(s, turn);
    const glm::dvec3 body = ray.origin + radius * ray.direction;

    double fine = 0.0;
    const double carved = carving(body, turn);
    const double rough = weathering_->roughness(body, fine);
    const double out = std::max(0.01, radius + 0.010 * carved + rough);
    return {ray.origin + out * ray.direction, weathering_->color(body, std::clamp(carved, -1.0, 1.0), fine)};
  }

  void band(std::uint64_t row, std::uint32_t upper_start, std::uint32_t lower_start,
            std::vector<std::uint32_t>& corners) const override {
    const std::uint64_t upper = quarter(row);
    const std::uint64_t lower = quarter(row + 1);
    const std::uint64_t longer = std::max(upper, lower);
    for (std::uint64_t quadrant = 0; quadrant < 4; ++quadrant) {
      const auto at = [quadrant](std::uint32_t start, std::uint64_t size, std::uint64_t j) {
        return size == 0 ? start : start + static_cast<std::uint32_t>((quadrant * size + j) % (4 * size));
      };
      for (std::uint64_t j = 0; j < longer; ++j) {
        const std::uint32_t u0 = at(upper_start, upper, j);
        const std::uint32_t l0 = at(lower_start, lower, j);
        const std::uint32_t u1 = at(upper_start, upper, j + 1);
        const std::uint32_t l1 = at(lower_start, lower, j + 1);

        // Triangles run counter-clockwise seen from outside, where turns run leftwards. A quadrant of the shorter ring
        // has one edge less.
        if (upper >= lower) {
          corners.insert(corners.end(), {u0, u1, l0});
          if (j < lower) corners.insert(corners.end(), {u1, l1, l0});
        } else {
          corners.insert(corners.end(), {u0, l1, l0});
          if (j < upper) corners.insert(corners.end(), {u0, u1, l1});
        }
      }
    }
  }

 private:
  /// How many vertices a ring has per quarter turn; 0 for a pole.
  std::uint64_t quarter(std::uint64_t row) const { return std::min({row, n_, rowCount() - 1 - row}); }

  /// The depth of the carving at a point of the body, in units of about a hundredth.
  double carving(const glm::dvec3& p, double turn) const {
    double c = 1.9 * drapery(p) + 1.1 * hair(p) + 1.0 * ornament(p, turn);

    // Tool marks are fine hatching in patches.
    const double hatch = resolved(0.022, edge_) * smooth(0.0, 0.5, valueNoise(p * 3.7, seed_ + 313U));
    if (hatch > 0.0) c += 0.12 * hatch * wave(46.0 * p.y + 21.0 * p.x - 13.0 * p.z);
    return c;
  }

  // Warped folds of a cloth over the breast, in [−1, 1], fade out where the cloth ends.
  double drapery(const glm::dvec3& p) const {
    const double where = smooth(0.36, 0.46, p.y) * (1.0 - smooth(0.98, 1.06, p.y + 0.35 * p.x));
    if (where <= 0.0) return 0.0;
    const double warp = 0.45 * valueNoise(p * 2.3, seed_ + 307U);
    const double w = wave(4.2 * p.x + 3.1 * p.y - 2.4 * p.z + warp);
    return where * (0.75 * w + 0.25 * wave(11.0 * p.x + 5.0 * p.y + 2.0 * warp));
  }

  double hair(const glm::dvec3& p) const {
    const double where = smooth(0.02, -0.06, p.z - 0.5 * (p.y - 1.70)) * smooth(1.52, 1.60, p.y);
    if (where <= 0.0) return 0.0;
    const double warp = valueNoise(p * 5.1, seed_ + 311U);
    return where * (0.65 * wave(9.0 * p.y + 7.0 * p.z + 0.6 * warp) +
                    0.35 * resolved(0.03, edge_) * wave(31.0 * p.y + 17.0 * p.z + 9.0 * p.x + 1.6 * warp));
  }

  // A frieze of rosettes runs around the plinth between two grooves.
  double ornament(const glm::dvec3& p, double turn) const {
    if (p.y > 0.34) return 0.0;
    const double groove = smooth(0.014, 0.004, std::abs(p.y - 0.135)) + smooth(0.014, 0.004, std::abs(p.y - 0.265));
    const double u = 20.0 * turn - static_cast<double>(static_cast<int>(20.0 * turn)) - 0.5;
    const double v = (p.y - 0.2) / 0.11;
    const double r2 = 4.0 * (u * u + v * v);
    const double ring = smooth(0.12, 0.02, std::abs(r2 - 0.62));
    const double knob = smooth(0.14, 0.04, r2);
    const double petals = smooth(0.05, 0.3, r2) * smooth(0.6, 0.4, r2) * smooth(0.02, -0.06, std::abs(u * v) - 0.03);
    return (ring + 0.8 * knob + 0.6 * petals) * smooth(0.135, 0.15, p.y) * smooth(0.265, 0.25, p.y) - groove;
  }

  std::uint32_t seed_;
  const RadiusTable& table_;
  std::uint64_t n_ = 0;
  std::uint64_t belt_ = 0;
  double edge_ = 0.0;
  std::unique_ptr<Weathering> weathering_;
};

}  // namespace

std::unique_ptr<SampleSurface> makeStatue(std::uint64_t triangles, std::uint64_t seed) {
  return std::make_unique<Statue>(triangles, seed);
}

}  // namespace mesh::generate
