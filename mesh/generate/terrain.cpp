// Generates hills under an orthophoto. They are a height field, and each picture covers a rectangle of it.
#include "mesh/generate/terrain_paint.h"

namespace mesh::generate {
namespace {

class Terrain : public TexturedSurface {
 public:
  Terrain(std::uint64_t triangles, std::uint64_t seed) : paint_(seed) {
    const GridCounts counts = chooseCounts(triangles, {kTerrainSize, 0.0}, kTerrainSize.x * kTerrainSize.y, {2, 2, 0},
                                           [](const GridCounts& c) { return 2 * std::uint64_t{c.columns} * c.rows; });
    sheets_ = {{divided({0.0, kTerrainSize.x}, counts.columns), divided({0.0, kTerrainSize.y}, counts.rows), 2}};
    edge_ = kTerrainSize.x / static_cast<double>(counts.columns);
  }

  const std::vector<Sheet>& sheets() const override { return sheets_; }
  AtlasStyle atlasStyle() const override { return {2, 0, true, false}; }
  std::uint64_t triangleCount() const override { return 2 * std::uint64_t{sheets_[0].columns()} * sheets_[0].rows(); }
  double area() const override { return kTerrainSize.x * kTerrainSize.y; }
  std::uint64_t vertexCount() const override { return std::uint64_t{sheets_[0].s.size()} * sheets_[0].t.size(); }
  glm::dvec3 position(std::uint64_t vertex) const override {
    const std::uint64_t line = sheets_[0].s.size();
    const glm::dvec2 p(sheets_[0].s[vertex % line], sheets_[0].t[vertex / line]);
    return {p, paint_.height(p, edge_)};
  }
  std::uint64_t vertexAt(std::uint32_t, std::uint32_t i, std::uint32_t j) const override {
    return std::uint64_t{j} * sheets_[0].s.size() + i;
  }
  bool hasQuad(std::uint32_t, std::uint32_t, std::uint32_t) const override { return true; }
  bool covers(std::uint32_t, const glm::dvec2&, double) const override { return true; }
  glm::dvec3 color(std::uint32_t, const glm::dvec2& st, double texel) const override {
    return paint_.ground(st, texel);
  }

 private:
  TerrainPaint paint_;
  std::vector<Sheet> sheets_;
  double edge_ = 1.0;
};

}  // namespace

std::unique_ptr<TexturedSurface> makeTerrain(std::uint64_t triangles, std::uint64_t seed) {
  return std::make_unique<Terrain>(triangles, seed);
}

}  // namespace mesh::generate
