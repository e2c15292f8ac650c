#include "mesh/generate/facade_paint.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

using glm::dvec2;
using glm::dvec3;

const dvec3 kCream(226.0, 214.0, 190.0);
const dvec3 kPlaster(205.0, 191.0, 166.0);
const dvec3 kPlinth(132.0, 127.0, 120.0);
const dvec3 kMortar(186.0, 176.0, 158.0);
const dvec3 kFrame(238.0, 236.0, 228.0);

// Levels of the horizontal bands, in metres.
constexpr double kPlinthTop = 0.5;
constexpr double kFriezeLow = 3.32, kFriezeHigh = 4.46;
constexpr double kStringLow = 7.60, kStringHigh = 7.76;
constexpr double kCorniceLow = 10.95;

/// The shade of an edge at a height, as far as `reach` metres below it.
struct Shade {
  double edge, reach, dark;
};

}  // namespace

const std::vector<Opening>& facadeOpenings() {
  static const std::vector<Opening> openings = [] {
    constexpr std::array<dvec2, 3> kStoreys{{{1.0, 3.0}, {5.2, 7.0}, {8.4, 10.2}}};
    std::vector<Opening> all;
    for (int storey = 0; storey < 3; ++storey)
      for (int bay = 0; bay < 5; ++bay) {
        const double x = 2.0 + 4.0 * bay;
        const dvec2& y = kStoreys[static_cast<std::size_t>(storey)];
        const bool door = storey == 0 && bay == 2;
        all.push_back({{x - 0.8, door ? 0.2 : y.x}, {x + 0.8, y.y}, door ? 0.40 : 0.28, door});
        all.back().first = storey == 0 && bay % 2 == 0;
      }
    return all;
  }();
  return openings;
}

const Opening& openingNear(const dvec2& p) {
  const auto bay = static_cast<std::size_t>(std::clamp(p.x / 4.0, 0.0, 4.0));
  const std::size_t storey = p.y < kFriezeHigh ? 0 : p.y < kStringHigh ? 1 : 2;
  return facadeOpenings()[5 * storey + bay];
}

FacadePaint::FacadePaint(std::uint64_t seed) : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0x9E3779B1U) {
  letter();
  lettering_.finish(kFacadeSize);
}

void FacadePaint::letter() {
  constexpr std::array<const char*, 4> kNames{"HOTEL LUMIGRID", "GRAND LUMIGRID", "HOUSE LUMIGRID", "VILLA LUMIGRID"};
  constexpr std::array<const char*, 4> kBanners{"MUSEUM", "ATRIUM", "THEATRE", "LIBRARY"};
  const std::uint32_t h = latticeHash(1, 2, 3, seed_);
  const auto line = [&](const std::string& text, double x, double y, double height) {
    lettering_.add(text, {x, y, 0.0}, height);
  };

  // The frieze carries the name of the house and smaller lines to both sides.
  line(kNames[h % 4U], 6.44, 3.60, 0.6);
  line("ROOMS & BREAKFAST", 1.5, 4.00, 0.22);
  line("SINCE " + std::to_string(1700 + static_cast<int>(h >> 8U) % 250), 1.5, 3.58, 0.22);
  line("CAFE - BAR - GARDEN", 15.0, 4.00, 0.22);
  line("OPEN 7 TO 22", 15.0, 3.58, 0.22);

  // A banner reads upwards, and a board hangs on the bricks.
  lettering_.add(kBanners[(h >> 4U) % 4U], {16.22, 4.95, 0.0}, 0.44, {0.0, 1.0});
  line("ATLAS", 3.47, 6.4, 0.25);
  line("OF STONE", 3.43, 6.0, 0.17);

  // A chart of lines, each two thirds as high as the one above, shows how fine a picture is.
  lettering_.addBoard({7.30, 1.02}, {8.70, 2.90});
  constexpr std::array<double, 9> kHeights{0.30, 0.20, 0.14, 0.10, 0.07, 0.05, 0.035, 0.025, 0.018};
  constexpr std::array<double, 9> kFeet{2.48, 2.16, 1.92, 1.74, 1.59, 1.47, 1.37, 1.29, 1.22};
  for (std::size_t i = 0; i < kHeights.size(); ++i) {
    const auto letters = static_cast<std::size_t>((1.2 * 7.0 / kHeights[i] + 1.0) / 6.0);
    const double width = (6.0 * static_cast<double>(letters) - 1.0) * kHeights[i] / 7.0;
    line(randomText(seed_ + 31U * static_cast<std::uint32_t>(i), letters), 8.0 - 0.5 * width, kFeet[i], kHeights[i]);
  }

  // Beside the door hang the menu, and plates on the next pillars.
  lettering_.addBoard({11.32, 1.10}, {12.68, 2.80});
  line("MENU", 11.74, 2.52, 0.16);
  constexpr std::array<const char*, 8> kDishes{
      "SOUP OF THE DAY 4.50",  "TROUT IN BUTTER 9.80", "ROAST WITH BEANS 8.20", "DUMPLINGS - 3   6.40",
      "PANCAKES & PLUMS 5.10", "CHEESE BOARD    7.00", "COFFEE 2.20   TEA 1.9", "WINE 0.2 L      3.60"};
  for (std::size_t i = 0; i < kDishes.size(); ++i) line(kDishes[i], 11.4, 2.34 - 0.13 * static_cast<double>(i), 0.063);
  line(std::to_string(10 + static_cast<int>(h >> 16U) % 90), 3.78, 2.0, 0.3);
  line("DR. A. MILLER", 15.55, 2.2, 0.08);
  line("SURVEYS & SCANS", 15.58, 2.02, 0.06);
  line("2ND FLOOR - RING TWICE", 15.58, 1.88, 0.04);
}

double FacadePaint::noise(const dvec2& p, double wavelength, double texel, std::uint32_t salt) const {
  const double seen = resolved(wavelength, texel);
  return seen > 0.0 ? seen * valueNoise(p / wavelength, seed_ + salt) : 0.0;
}

dvec3 FacadePaint::front(const dvec2& p, double texel) const {
  const Opening& o = openingNear(p);
  const double inside = coverage(p, o.low, o.high, texel);
  if (inside <= 0.0) return wall(p, texel);
  if (inside >= 1.0) return pane(o, p, texel);
  return blend(wall(p, texel), pane(o, p, texel), inside);
}

dvec3 FacadePaint::wall(const dvec2& p, double texel) const {
  const dvec3 built = surround(trims(masonry(p, texel), p, texel), openingNear(p), p, texel);
  return worn(lettering_.paint(built, p, texel), p, texel);
}

dvec3 FacadePaint::pane(const Opening& o, const dvec2& p, double texel) const {
  return worn(o.door ? door(o, p, texel) : window(o, p, texel), p, texel);
}

// Dust and wear lie over everything.
dvec3 FacadePaint::worn(const dvec3& color, const dvec2& p, double texel) const {
  return color * (1.0 + 0.03 * noise(p, 1.7, texel, 11U) + 0.025 * noise(p, 0.021, texel, 12U));
}

dvec3 FacadePaint::reveal(int side, double along, double inward, double texel) const {
  // Light comes from the front and above, so the lower side is the brightest and the depth is dark.
  constexpr std::array<double, 4> kLight{1.0, 0.80, 0.58, 0.86};
  const dvec2 p(along + 7.0 * side, inward);
  const double light = kLight[static_cast<std::size_t>(side)] * (1.0 - 0.35 * inward * inward);
  const double wear = 0.05 * noise(p, 0.31, texel, 21U) + 0.04 * noise(p, 0.017, texel, 22U);
  return (side == 0 ? dvec3(196.0, 190.0, 178.0) : kCream) * (light * (1.0 + wear));
}

dvec3 FacadePaint::colorAt(const dvec3& point, double texel) const {
  const dvec2 p(point);
  constexpr double kNear = 0.002;  // metres: how near to an opening's border a point of a reveal lies
  for (const Opening& o : facadeOpenings()) {
    const double inward = -point.z / o.depth;
    if (inward < 0.02 || inward > 0.8) continue;
    if (p.x < o.low.x - kNear || p.x > o.high.x + kNear || p.y < o.low.y - kNear || p.y > o.high.y + kNear) continue;
    if (p.y < o.low.y + kNear) return reveal(0, p.x - o.low.x, inward, texel);
    if (p.x > o.high.x - kNear) return reveal(1, p.y - o.low.y, inward, texel);
    if (p.y > o.high.y - kNear) return reveal(2, o.high.x - p.x, inward, texel);
    if (p.x < o.low.x + kNear) return reveal(3, o.high.y - p.y, inward, texel);
  }
  return front(p, texel);
}

// ---- The wall ----

dvec3 FacadePaint::masonry(const dvec2& p, double texel) const {
  dvec3 color;
  if (p.y > kFriezeHigh) {
    color = bricks(p, texel);
  } else if (p.y > kPlinthTop) {
    color = blocks(p, {0.95, 0.47}, kPlaster, texel);
  } else {
    color = blocks(p, {1.25, 0.5}, kPlinth, texel);
  }
  // The wall has stains, and rain washes it in streaks below the bands.
  const double stain = 0.10 * noise(p, 2.3, texel, 31U) + 0.06 * noise(p, 0.6, texel, 32U);
  const double streak = noise({p.x, 0.08 * p.y}, 0.14, texel, 33U);
  const double wet = smooth(1.6, 0.0, kCorniceLow - p.y) + smooth(0.9, 0.0, kStringLow - p.y) * (p.y < kStringLow) +
                     smooth(0.9, 0.0, p.y) * 0.8;
  return color * (1.0 + stain - 0.16 * wet * smooth(-0.1, 0.7, streak));
}

dvec3 FacadePaint::bricks(const dvec2& p, double texel) const {
  constexpr double kLength = 0.25, kHeight = 0.075, kJoint = 0.005;  // metres; a joint is twice kJoint wide
  const dvec3 mean(161.0, 96.0, 74.0);
  const double seen = resolved(kHeight, texel);
  if (seen <= 0.0) return mean;
  const std::int64_t row = floorToInt(p.y / kHeight);
  const double x = p.x + (row % 2 == 0 ? 0.0 : 0.5 * kLength);
  const std::int64_t column = floorToInt(x / kLength);
  const std::uint32_t h = latticeHash(column, row, 41, seed_);
  const double dx = x - kLength * static_cast<double>(column), dy = p.y - kHeight * static_cast<double>(row);

  // Bricks differ in their firing, and one in twelve is a dark clinker.
  dvec3 brick = blend({142.0, 68.0, 50.0}, {184.0, 108.0, 76.0}, part(h, 0)) * (0.86 + 0.24 * part(h, 8));
  if ((h >> 16U) % 12U == 0U) brick = brick * 0.62 + dvec3(8.0, 4.0, 8.0);
  brick *= 1.0 + 0.13 * noise(p, 0.024, texel, 42U) + 0.10 * noise(p, 0.006, texel, 43U);
  const double rim = std::min(std::min(dx, kLength - dx), std::min(dy, kHeight - dy));
  const double wobble = 0.0016 * noise(p, 0.03, texel, 44U);
  const double joint = 1.0 - coverage(rim - kJoint + wobble, std::max(texel, 0.003));
  const dvec3 mortar = kMortar * (0.94 + 0.10 * noise(p, 0.009, texel, 45U));
  return blend(mean, blend(brick, mortar, joint), seen);
}

dvec3 FacadePaint::blocks(const dvec2& p, const dvec2& size, const dvec3& color, double texel) const {
  const std::int64_t row = floorToInt(p.y / size.y);
  const double x = p.x + (row % 2 == 0 ? 0.0 : 0.5 * size.x);
  const std::int64_t column = floorToInt(x / size.x);
  const std::uint32_t h = latticeHash(column, row, 51, seed_);
  const double dx = x - size.x * static_cast<double>(column), dy = p.y - size.y * static_cast<double>(row);
  const double rim = std::min(std::min(dx, size.x - dx), std::min(dy, size.y - dy));
  const double groove = 1.0 - coverage(rim - 0.012, std::max(texel, 0.006));
  const double grain = 0.06 * noise(p, 0.11, texel, 52U) + 0.06 * noise(p, 0.013, texel, 53U);
  return color * ((0.94 + 0.10 * part(h, 0) + grain) * (1.0 - 0.42 * groove));
}

dvec3 FacadePaint::trims(const dvec3& wall, const dvec2& p, double texel) const {
  // Corner stones are long and short in turn.
  dvec3 color = wall;
  if (p.y > kFriezeHigh) {
    const double row = p.y / 0.42;
    const double reach = floorToInt(row) % 2 == 0 ? 0.75 : 0.5;
    const double fromSide = std::min(p.x, kFacadeSize.x - p.x);
    const double dy = 0.42 * (row - static_cast<double>(floorToInt(row)));
    const double joint = 1.0 - coverage(std::min(dy, 0.42 - dy) - 0.008, std::max(texel, 0.004));
    color = blend(color, kCream * (0.93 - 0.35 * joint), coverage(reach - fromSide, texel));
  }

  // Bands of stone run across, and the cornice has a row of teeth.
  const auto band = [&](double low, double high, const dvec3& stone) {
    color = blend(color, stone, coverage(std::min(p.y - low, high - p.y), texel));
  };
  const dvec3 stone = kCream * (1.0 + 0.04 * noise(p, 0.4, texel, 61U) + 0.04 * noise(p, 0.012, texel, 62U));
  band(kFriezeLow, kFriezeHigh, stone * 0.97);
  band(kFriezeLow, kFriezeLow + 0.07, stone * 1.05);
  band(kFriezeHigh - 0.10, kFriezeHigh, stone * 1.05);
  band(kStringLow, kStringHigh, stone);
  band(kCorniceLow, kFacadeSize.y, stone);
  const double tooth = p.x / 0.24 - static_cast<double>(floorToInt(p.x / 0.24));
  const double gap = coverage((std::abs(tooth - 0.5) - 0.28) * 0.24, texel);
  color *= 1.0 - 0.5 * gap * coverage(std::min(p.y - 11.05, 11.24 - p.y), texel);

  // Whatever juts out shades the wall beneath it.
  constexpr std::array<Shade, 4> kShades{
      {{kCorniceLow, 0.55, 0.38}, {kStringLow, 0.16, 0.26}, {kFriezeLow, 0.16, 0.26}, {11.36, 0.10, 0.30}}};
  for (const Shade& shade : kShades)
    if (p.y < shade.edge) color *= 1.0 - shade.dark * smooth(shade.reach, 0.0, shade.edge - p.y);
  return color;
}

// ---- Openings ----

dvec3 FacadePaint::surround(const dvec3& wall, const Opening& o, const dvec2& p, double texel) const {
  const dvec2 d = glm::max(glm::max(o.low - p, p - o.high), dvec2(0.0));
  if (std::max(d.x, d.y) > 1.2) return wall;
  const double around = coverage(p, o.low - kSurround, o.high + kSurround, texel);
  const double groove = 1.0 - coverage(std::abs(std::max(d.x, d.y) - 0.13) - 0.006, std::max(texel, 0.004));
  dvec3 color = wall;

  // Dirt runs down from the sill, and the sill shades the wall.
  const double beneath = o.low.y - kSillHeight - p.y;
  if (!o.door && beneath > 0.0 && p.x > o.low.x - kSillReach && p.x < o.high.x + kSillReach) {
    const double streak = noise({p.x, 0.1 * p.y}, 0.09, texel, 71U);
    color *= 1.0 - 0.24 * smooth(0.8, 0.0, beneath) * smooth(-0.2, 0.6, streak) - 0.3 * smooth(0.10, 0.0, beneath);
  }
  color = blend(color, kCream * (1.02 - 0.25 * groove + 0.04 * noise(p, 0.3, texel, 72U)), around);
  if (o.door) return color;
  const double sill =
      coverage(p, {o.low.x - kSillReach, o.low.y - kSillHeight}, {o.high.x + kSillReach, o.low.y}, texel);
  return blend(color, dvec3(203.0, 197.0, 184.0) * (1.0 + 0.05 * noise(p, 0.05, texel, 73U)), sill);
}

dvec3 FacadePaint::window(const Opening& o, const dvec2& p, double texel) const {
  const dvec2 q = p - o.low, size = o.high - o.low;
  const double transom = 0.68 * size.y;
  const double rim = std::min(std::min(q.x, size.x - q.x), std::min(q.y, size.y - q.y));
  const double bar = std::min({rim - 0.08, std::abs(q.x - 0.5 * size.x) - 0.04, std::abs(q.y - transom) - 0.03,
                               std::abs(q.y - 0.34 * size.y) - 0.014});
  // A dark line stands between frame and glass.
  const dvec3 frame = kFrame * (0.98 + 0.03 * noise(p, 0.02, texel, 81U) - 0.25 * coverage(bar + 0.006, texel));
  const dvec3 color = blend(frame, glass(o, q, texel), coverage(bar, texel));
  return color * (1.0 - 0.38 * smooth(0.35, 0.0, size.y - q.y) - 0.12 * smooth(0.15, 0.0, std::min(q.x, size.x - q.x)));
}

dvec3 FacadePaint::glass(const Opening& o, const dvec2& q, double texel) const {
  const dvec2 size = o.high - o.low;
  const std::uint32_t h =
      latticeHash(static_cast<std::int64_t>(o.low.x), static_cast<std::int64_t>(o.low.y), 82, seed_);
  const double height = q.y / size.y;

  // The sky with clouds is reflected above, the street below.
  const double cloud = noise(q + o.low, 0.9, texel, 83U) + 0.5 * noise(q + o.low, 0.37, texel, 84U);
  dvec3 color = blend({36.0, 44.0, 54.0}, {104.0, 132.0, 158.0}, height * height);
  color = blend(color, {196.0, 206.0, 214.0}, 0.55 * height * smooth(0.0, 0.7, cloud));
  if (h % 5U == 0U) color = blend(color, {226.0, 178.0, 104.0}, 0.55);  // a lamp is lit

  // Curtains hang at both sides, more or less open.
  const double open = 0.18 + 0.34 * part(h, 8);
  const double fromSide = std::min(q.x, size.x - q.x);
  const double folds = wave(9.0 * q.x + 0.35 * noise(q, 0.5, texel, 85U)) * resolved(0.11, texel);
  const double curtain = coverage(open * (0.8 + 0.3 * (1.0 - height)) - fromSide, std::max(texel, 0.01));
  const dvec3 cloth = (h >> 16U) % 3U == 0U ? dvec3(178.0, 140.0, 128.0) : dvec3(206.0, 201.0, 190.0);
  return blend(color, cloth * (0.74 + 0.14 * folds), 0.8 * curtain);
}

dvec3 FacadePaint::door(const Opening& o, const dvec2& p, double texel) const {
  const dvec2 q = p - o.low, size = o.high - o.low;
  const double rim = std::min(std::min(q.x, size.x - q.x), size.y - q.y);
  const double leaf = 2.2;  // metres: the leaves' height, below a window
  const dvec3 wood = dvec3(52.0, 84.0, 70.0) * (1.0 + 0.10 * noise({p.x, 0.05 * p.y}, 0.016, texel, 91U));
  if (q.y > leaf) {
    const double bar = std::min(rim - 0.07, q.y - leaf - 0.06);
    return blend(wood, glass(o, q, texel), coverage(bar, texel)) * (1.0 - 0.35 * smooth(0.3, 0.0, size.y - q.y));
  }
  // Each of the two leaves has three panels and meets the other in a dark line.
  const double half = 0.5 * size.x;
  const double x = q.x < half ? q.x : size.x - q.x;
  dvec3 color = wood;
  for (const dvec2& panel : {dvec2(0.15, 0.7), dvec2(0.82, 1.42), dvec2(1.54, 2.08)}) {
    const double edge = std::min(std::min(x - 0.14, half - 0.10 - x), std::min(q.y - panel.x, panel.y - q.y));
    color *= 1.0 - 0.4 * coverage(0.014 - std::abs(edge), std::max(texel, 0.006));
    color *= 1.0 + 0.12 * coverage(edge - 0.03, std::max(texel, 0.01));
  }
  color *= 1.0 - 0.7 * coverage(0.006 - (half - x), texel);
  const double knob = glm::length(dvec2(q.x - half - 0.07, q.y - 1.05));
  color = blend(color, {204.0, 168.0, 84.0}, coverage(0.035 - knob, texel));
  return color * (1.0 - 0.3 * smooth(0.4, 0.0, q.y));
}

std::unique_ptr<SurfacePaint> makeFacadePaint(std::uint64_t seed) {
  return std::make_unique<FacadePaint>(seed);
}

}  // namespace mesh::generate
