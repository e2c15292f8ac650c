#include "mesh/generate/terrain_paint.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

using glm::dvec2;
using glm::dvec3;

constexpr double kRoadHalf = 3.5;    // metres from the middle of a road to its rim
constexpr int kTable = 256;          // cells along a side of the table of slopes; a choice
constexpr double kSignReach = 15.0;  // metres over which the hills become the plane of a sign

// The field in the north-west, with rows of a crop.
constexpr dvec2 kFieldLow{6.0, 132.0}, kFieldHigh{52.0, 194.0};

}  // namespace

TerrainPaint::TerrainPaint(std::uint64_t seed)
    : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0x27D4EB2FU),
      phase_(part(latticeHash(5, 6, 7, seed_), 0)) {
  letter();
  lettering_.finish(kTerrainSize);
  shadeHills();
}

void TerrainPaint::letter() {
  const auto block = [&](const dvec2& low, const dvec2& high, const dvec2& corner, std::vector<std::string> lines,
                         const std::vector<double>& heights) {
    const double level = hills(0.5 * (low + high));
    lettering_.addBoard(low, high, level);
    dvec2 foot = corner;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      lettering_.add(lines[i], {foot, level}, heights[i]);
      if (i + 1 < lines.size()) foot.y -= 1.75 * heights[i + 1] + 0.1 * heights[i];
    }
  };
  block({108.0, 154.0}, {186.0, 187.0}, {114.0, 174.0},
        {"LUMIGRID", "TERRAIN 200 X 200 M", randomText(seed_ + 1U, 30), randomText(seed_ + 2U, 48),
         randomText(seed_ + 3U, 60), randomText(seed_ + 4U, 60)},
        {9.0, 4.0, 2.0, 1.2, 0.7, 0.4});
  block({8.0, 30.0}, {44.0, 52.0}, {12.0, 44.0},
        {"PARKING", "LEVEL " + std::to_string(latticeHash(1, 1, 1, seed_) % 90U + 10U), "CARS - BUSES - TRAMS",
         "LEAVE BY THE ROAD TO THE NORTH", randomText(seed_ + 5U, 40)},
        {4.4, 3.0, 1.6, 0.8, 0.5});

  // Two signs lie at an angle. The first one's direction has sides of 4 and 3 parts in 5.
  const dvec2 turned(0.8, 0.6);
  lettering_.add("LANDING " + std::to_string(latticeHash(2, 1, 1, seed_) % 36U + 10U),
                 {110.0, 16.0, hills(dvec2(126.0, 30.0))}, 5.0, turned);
  lettering_.add("NORTH", {30.0, 150.0, hills(dvec2(27.0, 162.0))}, 6.0, {0.0, 1.0});
}

// ---- Heights ----

double TerrainPaint::hills(const dvec2& p) const {
  const dvec2 turned(0.8 * p.x + 0.6 * p.y, -0.6 * p.x + 0.8 * p.y);
  return 10.0 + 7.0 * valueNoise(p / 90.0, seed_ + 1U) + 3.2 * valueNoise(turned / 41.0, seed_ + 2U) +
         1.4 * valueNoise(p / 19.0, seed_ + 3U);
}

double TerrainPaint::height(const dvec2& p, double edge) const {
  double height = hills(p);
  double rough = 0.0;
  double wavelength = 9.0, amplitude = 0.42;
  for (std::uint32_t octave = 0; octave < 12; ++octave) {
    const double seen = resolved(wavelength, edge);
    if (seen <= 0.0) break;
    rough += seen * amplitude * valueNoise(p / wavelength + 0.41 * octave, seed_ + 100U + octave);
    wavelength /= 2.03;
    amplitude *= 0.5;
  }
  // A road is as high as its middle line, across all of its width.
  for (const RoadPlace& place : {alongSecond(p), alongFirst(p)}) {
    const double share = smooth(16.0, kRoadHalf + 1.0, place.aside);
    if (share <= 0.0) continue;
    height += share * (hills(place.middle) - height);
    rough *= 1.0 - share;
  }
  const Lettering::Nearness sign = lettering_.nearness(p, kSignReach);
  return height + rough + sign.share * (sign.level - height - rough);
}

TerrainPaint::RoadPlace TerrainPaint::alongFirst(const dvec2& p) const {
  constexpr double kPeriod = 210.0, kSwing = 13.0;
  const double t = p.x / kPeriod + phase_;
  const double y = 100.0 + kSwing * wave(t);
  const double slope = (wave(t + 0.001) - wave(t - 0.001)) * kSwing / (0.002 * kPeriod);
  return {p.x, std::abs(p.y - y) / std::sqrt(1.0 + slope * slope), {p.x, y}};
}

TerrainPaint::RoadPlace TerrainPaint::alongSecond(const dvec2& p) const {
  constexpr double kPeriod = 160.0, kSwing = 9.0;
  const double t = p.y / kPeriod + 0.5 * phase_;
  const double x = 76.0 + kSwing * wave(t);
  const double slope = (wave(t + 0.001) - wave(t - 0.001)) * kSwing / (0.002 * kPeriod);
  return {p.y, std::abs(p.x - x) / std::sqrt(1.0 + slope * slope), {x, p.y}};
}

// ---- Colours ----

void TerrainPaint::shadeHills() {
  const dvec2 step = kTerrainSize / static_cast<double>(kTable);
  slope_and_light_.resize((kTable + 1) * (kTable + 1));
  const auto at = [&](int x, int y) { return height(step * dvec2(x, y), 2.0); };
  std::vector<double> heights((kTable + 2) * (kTable + 2));
  for (int y = 0; y <= kTable + 1; ++y)
    for (int x = 0; x <= kTable + 1; ++x) heights[static_cast<std::size_t>(y * (kTable + 2) + x)] = at(x, y);
  for (int y = 0; y <= kTable; ++y)
    for (int x = 0; x <= kTable; ++x) {
      const auto i = static_cast<std::size_t>(y * (kTable + 2) + x);
      const dvec2 rise((heights[i + 1] - heights[i]) / step.x, (heights[i + kTable + 2] - heights[i]) / step.y);
      // The sun stands in the north-west.
      const double light = (0.4 * rise.x - 0.4 * rise.y + 0.8) / std::sqrt(1.0 + glm::dot(rise, rise)) / 0.8;
      slope_and_light_[static_cast<std::size_t>(y * (kTable + 1) + x)] = {glm::length(rise), std::max(light, 0.6)};
    }
}

dvec2 TerrainPaint::slopeAndLight(const dvec2& p) const {
  const dvec2 at = glm::clamp(p / kTerrainSize, 0.0, 1.0) * static_cast<double>(kTable);
  const int x = std::min(static_cast<int>(at.x), kTable - 1), y = std::min(static_cast<int>(at.y), kTable - 1);
  const dvec2 share = at - dvec2(x, y);
  const dvec2* row = &slope_and_light_[static_cast<std::size_t>(y * (kTable + 1) + x)];
  const dvec2 low = row[0] + (row[1] - row[0]) * share.x;
  const dvec2 high = row[kTable + 1] + (row[kTable + 2] - row[kTable + 1]) * share.x;
  return low + (high - low) * share.y;
}

// Octaves that are turned against each other hide the lattice. Both turns have sides of whole numbers.
double TerrainPaint::noise(const dvec2& p, double wavelength, double texel, std::uint32_t salt) const {
  const double seen = resolved(wavelength, texel);
  if (seen <= 0.0) return 0.0;
  const dvec2 turn = salt % 2U == 0U ? dvec2(0.8, 0.6) : dvec2(0.28, -0.96);
  const dvec2 turned(turn.x * p.x + turn.y * p.y, -turn.y * p.x + turn.x * p.y);
  return seen * valueNoise(turned / wavelength, seed_ + salt);
}

dvec3 TerrainPaint::ground(const dvec2& p, double texel) const {
  const RoadPlace first = alongFirst(p), second = alongSecond(p);
  dvec3 color = meadow(p, texel);
  if (std::min(first.aside, second.aside) > kRoadHalf) color = withTrees(color, p, texel);
  // The second road has no markings where it meets the first.
  color = road(color, second, p, smooth(kRoadHalf, kRoadHalf + 1.5, first.aside), texel);
  color = road(color, first, p, 1.0, texel);
  const dvec3 lettered = lettering_.paint(color, p, texel);
  return lettered * (1.0 + 0.03 * noise(p, 0.9, texel, 12U) + 0.03 * noise(p, 0.07, texel, 13U));
}

dvec3 TerrainPaint::meadow(const dvec2& p, double texel) const {
  const dvec2 relief = slopeAndLight(p);
  const double wide = noise(p, 31.0, texel, 21U) + 0.5 * noise(p, 11.0, texel, 22U);
  const double fine =
      0.5 * noise(p, 1.7, texel, 23U) + 0.4 * noise(p, 0.45, texel, 24U) + 0.3 * noise(p, 0.12, texel, 25U);
  dvec3 color = blend({84.0, 106.0, 48.0}, {140.0, 138.0, 82.0}, smooth(-0.7, 0.8, wide + 0.3 * fine));

  // Soil shows in patches, and rock where it is steep.
  const double bare = smooth(0.55, 0.85, noise(p, 17.0, texel, 26U) + 0.45 * fine);
  color = blend(color, {138.0, 112.0, 82.0}, bare);
  const double rock = smooth(0.42, 0.62, relief.x + 0.12 * fine);
  color = blend(color, dvec3(146.0, 141.0, 132.0) * (1.0 + 0.25 * noise(p, 0.8, texel, 27U)), rock);

  // The crop stands in rows, and tracks of wheels run through it.
  const double field = coverage(p, kFieldLow, kFieldHigh, std::max(texel, 0.6));
  if (field > 0.0) {
    const double rows = wave(p.x / 0.9 + 0.1 * noise(p, 2.0, texel, 28U)) * resolved(0.9, texel);
    const double track = std::abs(p.x / 11.5 - static_cast<double>(floorToInt(p.x / 11.5)) - 0.5) * 11.5;
    const double wheels = coverage(0.22 - std::abs(track - 0.9), std::max(texel, 0.1));
    const dvec3 crop = blend({178.0, 158.0, 88.0}, {128.0, 136.0, 62.0}, 0.5 + 0.32 * rows + 0.15 * wide);
    color = blend(color, blend(crop, {120.0, 98.0, 70.0}, 0.8 * wheels), field);
  }
  return color * (relief.y * (1.0 + 0.16 * fine));
}

dvec3 TerrainPaint::withTrees(const dvec3& color, const dvec2& p, double texel) const {
  // Bushes stand under trees. `cell` is the side of a square that holds one at most, in metres.
  constexpr std::array<Plant, 3> kPlants{{{3.1, 0.35, 0.9, 0.30}, {6.3, 0.9, 2.1, 0.42}, {10.7, 1.9, 4.2, 0.50}}};
  dvec3 result = color;
  for (const Plant& plant : kPlants) result = withPlant(result, plant, p, texel);
  return result;
}

dvec3 TerrainPaint::withPlant(const dvec3& color, const Plant& plant, const dvec2& p, double texel) const {
  const auto salt = static_cast<std::uint32_t>(plant.cell);
  const std::int64_t x = floorToInt(p.x / plant.cell), y = floorToInt(p.y / plant.cell);
  const std::uint32_t h = latticeHash(x, y, 31, seed_ + salt);
  const double radius = plant.min_radius + (plant.max_radius - plant.min_radius) * part(h, 0) * part(h, 4);
  const double room = plant.cell - 2.0 * radius - 0.9;  // for the shadow, too
  const dvec2 middle = plant.cell * dvec2(x, y) + 0.3 + radius + std::max(room, 0.0) * dvec2(part(h, 8), part(h, 16));
  const double forest = valueNoise(middle / 41.0, seed_ + 32U) + 0.9 * part(h, 24) - 0.35;
  if (forest < plant.rarity) return color;
  const dvec2 away = p - middle;
  const double reach = 1.25 * radius + 0.7;  // with ragged rim and shadow
  if (glm::dot(away, away) > reach * reach) return color;
  const bool on_road = std::min(alongFirst(middle).aside, alongSecond(middle).aside) < kRoadHalf + 1.5 + radius;
  const bool in_field = coverage(middle, kFieldLow - 2.0, kFieldHigh + 2.0, texel) > 0.0;
  if (on_road || in_field || lettering_.nearness(middle, radius + 1.0).share > 0.0) return color;

  // The crown is round with a ragged rim, lit from the north-west, and its shadow falls to the south-east.
  const auto crown = [&](const dvec2& at) {
    const double ragged = 0.26 * noise(at, 0.9, texel, 33U) + 0.14 * noise(at, 0.35, texel, 34U);
    return coverage(radius * (0.82 + ragged) - glm::length(at - middle), std::max(texel, 0.12));
  };
  const double share = crown(p);
  const double shadow = (1.0 - share) * crown(p - dvec2(0.4, -0.4));
  const dvec2 q = away / radius;
  const double leaves = 0.24 * noise(p, 0.55, texel, 35U) + 0.2 * noise(p, 0.17, texel, 36U);
  const dvec3 green = blend({46.0, 70.0, 34.0}, {84.0, 98.0, 44.0}, part(h, 12));
  return blend(color * (1.0 - 0.5 * shadow), green * (1.0 + leaves + 0.35 * (q.y - q.x)), share);
}

dvec3 TerrainPaint::road(const dvec3& color, const RoadPlace& place, const dvec2& p, double markings,
                         double texel) const {
  if (place.aside > kRoadHalf + 2.0) return color;
  const double ragged = 0.25 * noise(p, 0.8, texel, 41U);
  const dvec3 gravel = dvec3(156.0, 146.0, 126.0) * (1.0 + 0.16 * noise(p, 0.16, texel, 42U));
  const double patched = smooth(0.3, 0.4, noise(p, 5.0, texel, 44U));
  const dvec3 asphalt = dvec3(98.0, 97.0, 98.0) *
                        (1.0 - 0.14 * patched + 0.05 * noise(p, 0.1, texel, 43U) + 0.05 * noise(p, 3.1, texel, 45U));
  dvec3 result = blend(color, gravel, coverage(kRoadHalf + 0.9 + ragged - place.aside, std::max(texel, 0.2)));
  result = blend(result, asphalt, coverage(kRoadHalf - place.aside, texel));
  const double dash = place.along / 6.0 - static_cast<double>(floorToInt(place.along / 6.0));
  const double paint = coverage(0.07 - std::abs(place.aside - 3.1), texel) +
                       coverage(0.08 - place.aside, texel) * coverage((0.25 - std::abs(dash - 0.5)) * 6.0, texel);
  return blend(result, {232.0, 231.0, 224.0}, 0.92 * markings * std::min(paint, 1.0));
}

std::unique_ptr<SurfacePaint> makeTerrainPaint(std::uint64_t seed) {
  return std::make_unique<TerrainPaint>(seed);
}

}  // namespace mesh::generate
