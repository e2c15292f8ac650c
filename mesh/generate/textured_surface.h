#pragma once
// The surfaces that textured.h generates consist of sheets: grids of quads, each with its own texture coordinates.
// Sheets may share vertices. As in surface.h only + − × ÷ and sqrt are used.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <vector>

#include "mesh/generate/textured.h"

namespace mesh::generate {

/// A grid of quads between lines at s (columns) and t (rows), in metres and ascending. Seen from outside, s runs to the
/// right and t upwards.
struct Sheet {
  std::vector<double> s, t;
  std::uint32_t min_pieces = 1;  ///< into how many charts it is cut along s, and along t, at least
  std::uint32_t columns() const { return static_cast<std::uint32_t>(s.size() - 1); }
  std::uint32_t rows() const { return static_cast<std::uint32_t>(t.size() - 1); }
};

/// How charts lie in pictures.
struct AtlasStyle {
  int padding = 1;           ///< texels painted beyond a chart's border, so that interpolation finds its colours there
  int gap = 4;               ///< black texels between charts, and around them
  bool tiles = false;        ///< each chart has a picture of its own and lies in it as it stands
  bool turns_charts = true;  ///< some charts are turned by 90 degrees, some are mirrored
};

class TexturedSurface {
 public:
  virtual ~TexturedSurface() = default;
  virtual const std::vector<Sheet>& sheets() const = 0;
  virtual AtlasStyle atlasStyle() const = 0;
  virtual std::uint64_t triangleCount() const = 0;
  virtual double area() const = 0;  ///< square metres of all sheets, holes not counted
  virtual std::uint64_t vertexCount() const = 0;
  virtual glm::dvec3 position(std::uint64_t vertex) const = 0;
  /// The vertex where lines i and j of a sheet cross.
  virtual std::uint64_t vertexAt(std::uint32_t sheet, std::uint32_t i, std::uint32_t j) const = 0;
  /// Whether the sheet has the quad right of line i and above line j, or a hole there.
  virtual bool hasQuad(std::uint32_t sheet, std::uint32_t i, std::uint32_t j) const = 0;
  /// Whether a point of the sheet lies on it or less than `margin` from it, in metres.
  virtual bool covers(std::uint32_t sheet, const glm::dvec2& st, double margin) const = 0;
  /// The mean colour, in 0..255, over about `texel` x `texel` metres.
  virtual glm::dvec3 color(std::uint32_t sheet, const glm::dvec2& st, double texel) const = 0;
};

std::unique_ptr<TexturedSurface> makeFacade(std::uint64_t triangles, std::uint64_t seed);
std::unique_ptr<TexturedSurface> makeTerrain(std::uint64_t triangles, std::uint64_t seed);
std::unique_ptr<TexturedSurface> makeRooms(std::uint64_t triangles, std::uint64_t seed);
std::unique_ptr<SurfacePaint> makeFacadePaint(std::uint64_t seed);
std::unique_ptr<SurfacePaint> makeTerrainPaint(std::uint64_t seed);
std::unique_ptr<SurfacePaint> makeRoomsPaint(std::uint64_t seed);

// ---- Division into quads ----

struct GridCounts {
  std::uint32_t columns = 0;
  std::uint32_t rows = 0;
  std::uint32_t depth = 0;  ///< quads along the depth of openings
};

/// The counts whose quads are about square and whose triangles are nearest to `wanted`. `size` holds width, height and
/// depth in metres, `area` is the area of all the surface in square metres, `least` holds the smallest counts.
GridCounts chooseCounts(std::uint64_t wanted, const glm::dvec3& size, double area, const GridCounts& least,
                        const std::function<std::uint64_t(const GridCounts&)>& countTriangles);

/// Lines between breaks (ascending), `count` quads in all: each stretch has its share by length, and one at least.
std::vector<double> divided(const std::vector<double>& breaks, std::uint32_t count);

// ---- Painting ----

/// The share of a texel that lies on the positive side of an edge, from its centre's signed distance to it.
double coverage(double distance, double texel);
/// The share of a texel that lies in a box.
double coverage(const glm::dvec2& p, const glm::dvec2& low, const glm::dvec2& high, double texel);
/// Eight bits of a hash as a number in [0, 1].
double part(std::uint32_t hash, std::uint32_t shift);
glm::dvec3 blend(const glm::dvec3& a, const glm::dvec3& b, double share);

}  // namespace mesh::generate
