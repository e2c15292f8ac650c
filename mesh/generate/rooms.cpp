// Generates a flat as a scanner in its rooms sees it. Each panel is a sheet of its own, whose vertices it shares with
// none.
#include <algorithm>
#include <cmath>

#include "mesh/generate/rooms_paint.h"
#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

using glm::dvec2;
using glm::dvec3;

class Rooms : public TexturedSurface {
 public:
  Rooms(std::uint64_t triangles, std::uint64_t seed) : seed_(static_cast<std::uint32_t>(seed)), paint_(seed) {
    for (const RoomPanel& panel : paint_.panels()) area_ += (panel.high.x - panel.low.x) * (panel.high.y - panel.low.y);
    const std::vector<Counts> counts = divide(triangles);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const RoomPanel& panel = paint_.panels()[i];
      sheets_.push_back({divided({panel.low.x, panel.high.x}, counts[i].columns),
                         divided({panel.low.y, panel.high.y}, counts[i].rows)});
      first_.push_back(vertices_);
      vertices_ += std::uint64_t{counts[i].columns + 1} * (counts[i].rows + 1);
      triangles_ += 2 * std::uint64_t{counts[i].columns} * counts[i].rows;
    }
  }

  const std::vector<Sheet>& sheets() const override { return sheets_; }
  AtlasStyle atlasStyle() const override { return {}; }
  std::uint64_t triangleCount() const override { return triangles_; }
  double area() const override { return area_; }
  std::uint64_t vertexCount() const override { return vertices_; }

  dvec3 position(std::uint64_t vertex) const override {
    const auto sheet =
        static_cast<std::size_t>(std::upper_bound(first_.begin(), first_.end(), vertex) - first_.begin()) - 1;
    const Sheet& lines = sheets_[sheet];
    const std::uint64_t number = vertex - first_[sheet];
    const dvec2 st(lines.s[number % lines.s.size()], lines.t[number / lines.s.size()]);
    const RoomPanel& panel = paint_.panels()[sheet];
    return panel.at(st) + height(panel, st) * glm::cross(panel.right, panel.up);
  }

  std::uint64_t vertexAt(std::uint32_t sheet, std::uint32_t i, std::uint32_t j) const override {
    return first_[sheet] + std::uint64_t{j} * sheets_[sheet].s.size() + i;
  }
  bool hasQuad(std::uint32_t, std::uint32_t, std::uint32_t) const override { return true; }
  bool covers(std::uint32_t, const dvec2&, double) const override { return true; }
  dvec3 color(std::uint32_t sheet, const dvec2& st, double texel) const override {
    return paint_.color(paint_.panels()[sheet], st, texel);
  }

 private:
  struct Counts {
    std::uint32_t columns = 1, rows = 1;
  };

  std::vector<Counts> countsFor(double edge) const {
    const auto along = [&](double length) {
      return static_cast<std::uint32_t>(std::max<std::int64_t>(1, floorToInt(length / edge + 0.5)));
    };
    std::vector<Counts> counts;
    for (const RoomPanel& panel : paint_.panels())
      counts.push_back({along(panel.high.x - panel.low.x), along(panel.high.y - panel.low.y)});
    return counts;
  }
  static std::uint64_t total(const std::vector<Counts>& counts) {
    std::uint64_t sum = 0;
    for (const Counts& c : counts) sum += 2 * std::uint64_t{c.columns} * c.rows;
    return sum;
  }

  // Quads are about square and all of one size; what is still missing is made up for by a row more in some panels.
  std::vector<Counts> divide(std::uint64_t wanted) {
    double low = 0.0, high = 100.0;  // metres
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (total(countsFor(middle)) > wanted ? low : high) = middle;
    }
    edge_ = high;
    std::vector<Counts> counts = countsFor(high);
    std::uint64_t sum = total(counts);
    for (bool goes_on = true; goes_on;) {
      goes_on = false;
      for (Counts& c : counts) {
        const std::uint64_t more = 2 * std::uint64_t{c.columns};
        if (sum + more > wanted) continue;
        ++c.rows;
        sum += more;
        goes_on = true;
      }
    }
    return counts;
  }

  // Metres towards the room: what a scanner adds, none at borders, so that panels meet, and beneath signs.
  double height(const RoomPanel& panel, const dvec2& st) const {
    const dvec2 inside = glm::min(st - panel.low, panel.high - st);
    const double border = smooth(0.0, 0.12, std::min(inside.x, inside.y));
    if (border <= 0.0) return 0.0;
    double sum = 0.0, wavelength = 1.1, amplitude = 0.008;
    for (std::uint32_t octave = 0; octave < 8; ++octave) {
      const double seen = resolved(wavelength, edge_);
      if (seen <= 0.0) break;
      sum += seen * amplitude * valueNoise(panel.at(st) / wavelength + 0.41 * octave, seed_ + octave);
      wavelength /= 2.1;
      amplitude *= 0.5;
    }
    return border * (1.0 - paint_.evenness(panel, st)) * sum;
  }

  std::uint32_t seed_;
  RoomsPaint paint_;
  std::vector<Sheet> sheets_;
  std::vector<std::uint64_t> first_;  // vertex of each sheet
  double edge_ = 1.0;
  double area_ = 0.0;
  std::uint64_t triangles_ = 0;
  std::uint64_t vertices_ = 0;
};

}  // namespace

std::unique_ptr<TexturedSurface> makeRooms(std::uint64_t triangles, std::uint64_t seed) {
  return std::make_unique<Rooms>(triangles, seed);
}

}  // namespace mesh::generate
