// Generates a house front with windows and a door that are set back. The wall and the panes are one grid of vertices,
// and between them lie the reveals: for each opening rings of vertices around its border, the last ring the pane's.
#include <algorithm>
#include <cmath>

#include "mesh/generate/facade_paint.h"
#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

using glm::dvec2;
using glm::dvec3;

constexpr std::uint64_t kCoarsest = 4'000;  // triangles; below, three openings are set back, above, all fifteen
constexpr double kRevealDepth = 0.30;       // metres of texture from the wall to the panes

/// An opening in the grid: the lines that bound it, and its first vertex in a ring.
struct GridOpening {
  Opening shape;
  std::uint32_t left, right, bottom, top;
  std::uint64_t first_vertex = 0;
  std::uint32_t width() const { return right - left; }
  std::uint32_t height() const { return top - bottom; }
  std::uint32_t around() const { return 2 * (width() + height()); }
  bool holdsQuad(std::uint32_t i, std::uint32_t j) const { return i >= left && i < right && j >= bottom && j < top; }
  bool holdsVertex(std::uint32_t i, std::uint32_t j) const { return i > left && i < right && j > bottom && j < top; }

  /// The number along the border, counterclockwise from the lower left corner.
  std::uint32_t numberOf(std::uint32_t i, std::uint32_t j) const {
    if (j == bottom) return i - left;
    if (i == right) return width() + j - bottom;
    if (j == top) return width() + height() + right - i;
    return 2 * width() + height() + top - j;
  }
  glm::uvec2 lineOf(std::uint32_t number) const {
    if (number < width()) return {left + number, bottom};
    if (number < width() + height()) return {right, bottom + number - width()};
    if (number < 2 * width() + height()) return {right - (number - width() - height()), top};
    return {left, top - (number - 2 * width() - height())};
  }
};

class Facade : public TexturedSurface {
 public:
  Facade(std::uint64_t triangles, std::uint64_t seed)
      : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32U)) * 0xC2B2AE35U), paint_(seed) {
    for (const Opening& o : facadeOpenings())
      if (o.first || triangles >= kCoarsest) openings_.push_back({o, 0, 0, 0, 0});
    divide(triangles);
    edge_ = kFacadeSize.x / static_cast<double>(sheets_[0].columns());
    addSheets();
  }

  const std::vector<Sheet>& sheets() const override { return sheets_; }
  AtlasStyle atlasStyle() const override { return {}; }
  std::uint64_t triangleCount() const override { return triangles_; }
  double area() const override { return area_; }
  std::uint64_t vertexCount() const override { return vertices_; }

  dvec3 position(std::uint64_t vertex) const override {
    const std::uint64_t line = sheets_[0].s.size();
    if (vertex < first_ring_) {
      const auto i = static_cast<std::uint32_t>(vertex % line), j = static_cast<std::uint32_t>(vertex / line);
      const dvec2 p = pointOf({i, j});
      const GridOpening* o = openingAround(i, j);
      return {p, o != nullptr ? paneHeight(o->shape, p) : wallHeight(p)};
    }
    const GridOpening& o = *std::prev(
        std::upper_bound(openings_.begin(), openings_.end(), vertex,
                         [](std::uint64_t v, const GridOpening& opening) { return v < opening.first_vertex; }));
    const std::uint64_t in_rings = vertex - o.first_vertex;
    const double inward = static_cast<double>(in_rings / o.around() + 1) / static_cast<double>(layers_);
    const dvec2 p = pointOf(o.lineOf(static_cast<std::uint32_t>(in_rings % o.around())));
    const double wall = wallHeight(p);
    return {p, wall + (paneHeight(o.shape, p) - wall) * inward};
  }

  // The sheets are the wall, and for each opening its pane and four reveals.
  std::uint64_t vertexAt(std::uint32_t sheet, std::uint32_t i, std::uint32_t j) const override {
    if (sheet == 0) return static_cast<std::uint64_t>(j) * sheets_[0].s.size() + i;
    const GridOpening& o = openings_[(sheet - 1) / 5];
    const std::uint32_t side = (sheet - 1) % 5;
    if (side == 0) {
      const std::uint32_t column = o.left + i, row = o.bottom + j;
      if (o.holdsVertex(column, row)) return vertexAt(0, column, row);
      return o.first_vertex + std::uint64_t{layers_ - 1} * o.around() + o.numberOf(column, row);
    }
    const std::uint32_t begins[4] = {0, o.width(), o.width() + o.height(), 2 * o.width() + o.height()};
    const std::uint32_t number = (begins[side - 1] + i) % o.around();
    const glm::uvec2 line = o.lineOf(number);
    return j == 0 ? vertexAt(0, line.x, line.y) : o.first_vertex + std::uint64_t{j - 1} * o.around() + number;
  }

  bool hasQuad(std::uint32_t sheet, std::uint32_t i, std::uint32_t j) const override {
    return sheet != 0 ||
           std::none_of(openings_.begin(), openings_.end(), [&](const GridOpening& o) { return o.holdsQuad(i, j); });
  }

  bool covers(std::uint32_t sheet, const dvec2& st, double margin) const override {
    if (sheet != 0) return true;
    return std::none_of(openings_.begin(), openings_.end(), [&](const GridOpening& o) {
      return st.x > o.shape.low.x + margin && st.x < o.shape.high.x - margin && st.y > o.shape.low.y + margin &&
             st.y < o.shape.high.y - margin;
    });
  }

  dvec3 color(std::uint32_t sheet, const dvec2& st, double texel) const override {
    if (sheet == 0) {
      const bool set_back = openings_.size() == facadeOpenings().size() || openingNear(st).first;
      return set_back ? paint_.wall(st, texel) : paint_.front(st, texel);
    }
    if ((sheet - 1) % 5 == 0) return paint_.pane(openings_[(sheet - 1) / 5].shape, st, texel);
    return paint_.reveal(static_cast<int>((sheet - 1) % 5) - 1, st.x, st.y / kRevealDepth, texel);
  }

 private:
  // Chooses the lines of the grid, among them the borders of all openings.
  void divide(std::uint64_t triangles) {
    std::vector<double> x{0.0, kFacadeSize.x}, y{0.0, kFacadeSize.y};
    double border = 0.0;
    for (const GridOpening& o : openings_) {
      x.insert(x.end(), {o.shape.low.x, o.shape.high.x});
      y.insert(y.end(), {o.shape.low.y, o.shape.high.y});
      border += 2.0 * (o.shape.high.x - o.shape.low.x + o.shape.high.y - o.shape.low.y);
    }
    for (std::vector<double>* breaks : {&x, &y}) {
      std::sort(breaks->begin(), breaks->end());
      breaks->erase(std::unique(breaks->begin(), breaks->end()), breaks->end());
    }
    const auto placed = [&](const GridCounts& counts) {
      place(divided(x, counts.columns), divided(y, counts.rows));
      std::uint64_t quads = std::uint64_t{counts.columns} * counts.rows;
      for (const GridOpening& o : openings_) quads += std::uint64_t{counts.depth} * o.around();
      return 2 * quads;
    };
    const GridCounts least{static_cast<std::uint32_t>(x.size() - 1), static_cast<std::uint32_t>(y.size() - 1), 1};
    area_ = kFacadeSize.x * kFacadeSize.y + kRevealDepth * border;
    const GridCounts counts = chooseCounts(triangles, {kFacadeSize, kRevealDepth}, area_, least, placed);
    triangles_ = placed(counts);
    layers_ = counts.depth;
  }

  void place(std::vector<double> x, std::vector<double> y) {
    const auto lineAt = [](const std::vector<double>& lines, double at) {
      return static_cast<std::uint32_t>(std::lower_bound(lines.begin(), lines.end(), at) - lines.begin());
    };
    for (GridOpening& o : openings_) {
      o.left = lineAt(x, o.shape.low.x), o.right = lineAt(x, o.shape.high.x);
      o.bottom = lineAt(y, o.shape.low.y), o.top = lineAt(y, o.shape.high.y);
    }
    sheets_.assign(1, {std::move(x), std::move(y), 2});
  }

  void addSheets() {
    const std::vector<double> x = sheets_[0].s, y = sheets_[0].t;
    vertices_ = first_ring_ = x.size() * y.size();
    std::vector<double> depth;
    for (std::uint32_t j = 0; j <= layers_; ++j) depth.push_back(kRevealDepth * j / static_cast<double>(layers_));
    const auto stretch = [](const std::vector<double>& lines, std::uint32_t first, std::uint32_t last) {
      return std::vector<double>(lines.begin() + first, lines.begin() + last + 1);
    };
    const auto fromStart = [](std::vector<double> lines, bool backwards) {
      if (backwards) std::reverse(lines.begin(), lines.end());
      const double start = lines.front();
      for (double& line : lines) line = std::abs(line - start);
      return lines;
    };
    for (GridOpening& o : openings_) {
      o.first_vertex = vertices_;
      vertices_ += std::uint64_t{layers_} * o.around();
      const std::vector<double> across = stretch(x, o.left, o.right), upwards = stretch(y, o.bottom, o.top);
      sheets_.push_back({across, upwards});
      for (const bool backwards : {false, true}) {
        sheets_.push_back({fromStart(across, backwards), depth});
        sheets_.push_back({fromStart(upwards, backwards), depth});
      }
    }
  }

  dvec2 pointOf(const glm::uvec2& line) const { return {sheets_[0].s[line.x], sheets_[0].t[line.y]}; }

  const GridOpening* openingAround(std::uint32_t i, std::uint32_t j) const {
    for (const GridOpening& o : openings_)
      if (o.holdsVertex(i, j)) return &o;
    return nullptr;
  }

  // ---- Heights over the plane of the wall, in metres ----

  double wallHeight(const dvec2& p) const {
    const auto band = [&](double low, double high, double ramp) {
      return smooth(low - ramp, low, p.y) * smooth(high + ramp, high, p.y);
    };
    double height = 0.06 * smooth(0.53, 0.50, p.y);
    height = std::max(height, 0.08 * band(3.32, 3.39, 0.03));
    height = std::max(height, 0.12 * band(4.36, 4.46, 0.03));
    height = std::max(height, 0.10 * band(7.60, 7.76, 0.03));
    height = std::max(height, 0.12 * band(10.95, 12.1, 0.03));
    height = std::max(height, 0.38 * smooth(11.24, 11.38, p.y) - 0.10 * smooth(11.78, 11.84, p.y));
    if (p.y > 4.46 && p.y < 10.95)
      height = std::max(height, 0.04 * smooth(0.78, 0.74, std::min(p.x, kFacadeSize.x - p.x)));
    for (const GridOpening& o : openings_) height = std::max(height, frameHeight(o.shape, p));

    // The wall is a little uneven, but not beneath signs.
    const Lettering::Nearness sign = paint_.lettering().nearness(p, 0.25);
    if (sign.share >= 1.0) return 0.0;
    return height + (1.0 - sign.share) * (unevenness(p) - joints(p));
  }

  // The frame around an opening, and its sill.
  static double frameHeight(const Opening& o, const dvec2& p) {
    const dvec2 d = glm::max(glm::max(o.low - p, p - o.high), dvec2(0.0));
    if (std::max(d.x, d.y) > 0.5) return 0.0;
    const double frame = 0.05 * smooth(kSurround + 0.01, kSurround - 0.01, std::max(d.x, d.y));
    if (o.door || p.y > o.low.y || p.y < o.low.y - kSillHeight - 0.02 || d.x > kSillReach) return frame;
    return std::max(frame, 0.15 * smooth(o.low.y - kSillHeight - 0.02, o.low.y - kSillHeight, p.y));
  }

  double unevenness(const dvec2& p) const {
    double height = 0.0;
    double wavelength = 2.6, amplitude = 0.018;
    for (std::uint32_t octave = 0; octave < 12; ++octave) {
      const double seen = resolved(wavelength, edge_);
      if (seen <= 0.0) break;
      height += seen * amplitude * valueNoise(p / wavelength + 0.37 * octave, seed_ + octave);
      wavelength /= 2.03;
      amplitude *= 0.47;
    }
    return height;
  }

  // The joints between bricks are as in the paint, where triangles are fine enough.
  double joints(const dvec2& p) const {
    const double seen = resolved(0.075, edge_);
    if (seen <= 0.0 || p.y < 4.5 || p.y > 10.9) return 0.0;
    const double row = p.y / 0.075;
    const double dy = std::abs(row - static_cast<double>(floorToInt(row)) - 0.5) * 0.075;
    return seen * 0.006 * smooth(0.028, 0.034, dy);
  }

  double paneHeight(const Opening& o, const dvec2& p) const {
    const dvec2 q = p - o.low, size = o.high - o.low;
    const double rim = std::min(std::min(q.x, size.x - q.x), std::min(q.y, size.y - q.y));
    const double bar = o.door ? rim - 0.07 : std::min(rim - 0.08, std::abs(q.x - 0.5 * size.x) - 0.04);
    return -o.depth + 0.04 * smooth(0.02, 0.0, bar);
  }

  std::uint32_t seed_;
  FacadePaint paint_;
  std::vector<GridOpening> openings_;
  std::vector<Sheet> sheets_;
  std::uint32_t layers_ = 1;
  double edge_ = 1.0;
  double area_ = 0.0;
  std::uint64_t triangles_ = 0;
  std::uint64_t first_ring_ = 0;
  std::uint64_t vertices_ = 0;
};

}  // namespace

std::unique_ptr<TexturedSurface> makeFacade(std::uint64_t triangles, std::uint64_t seed) {
  return std::make_unique<Facade>(triangles, seed);
}

}  // namespace mesh::generate
