#pragma once
// Generates scans with textures (`lumigrid sample --shape facade`, `--shape terrain`, `--shape rooms`): an OBJ, its
// materials and their JPEGs. The seed determines every byte of the OBJ on any machine, and every pixel before it is
// encoded as JPEG. Memory holds one picture at a time, and the mesh is streamed.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"

namespace mesh::generate {

enum class TexturedShape {
  kFacade,   ///< a house front of 20 x 12 m, y up, that looks towards +z; its texture is an atlas of charts
  kTerrain,  ///< hills of 200 x 200 m, z up, under an orthophoto in tiles of one picture each
  kRooms,    ///< a flat of four rooms of 4.6 x 4 x 2.6 m, z up, seen from inside; its texture is an atlas of charts
};

inline constexpr std::uint64_t kMinTexturedTriangles = 128;          // a facade with three openings has 84 at least
inline constexpr std::uint64_t kMinRoomsTriangles = 500;             // its 96 panels have 192 at least; a choice
inline constexpr std::uint64_t kMaxTexturedTriangles = 100'000'000;  // readers keep 2^26 texture coordinates
inline constexpr std::uint64_t kMaxTexels = 100'000;                 // per triangle; a choice
inline constexpr int kMaxPictureSide = 4096;                         // texels; every GPU takes such pictures

/// The fewest triangles that a shape is made of.
constexpr std::uint64_t leastTriangles(TexturedShape shape) {
  return shape == TexturedShape::kRooms ? kMinRoomsTriangles : kMinTexturedTriangles;
}

struct TexturedOptions {
  TexturedShape shape = TexturedShape::kFacade;
  std::uint64_t triangles = 1'000'000;  ///< 128 (rooms: 500) … 10^8; the result differs by at most 2 %
  std::uint64_t texels = 500;           ///< texels for each triangle, on average: 1 … 10^5
  std::uint64_t seed = 1;
  glm::dvec3 origin{0.0};  ///< added to every position, as in survey coordinates
};

/// A line of text on the surface, dark on a light and even ground. Positions are without the options' origin.
struct Sign {
  std::string text;
  glm::dvec3 corner;  ///< the lower left corner of the first letter
  glm::dvec3 right;   ///< unit vector along the line
  glm::dvec3 up;      ///< unit vector from the letters' feet to their heads
  double height;      ///< metres from feet to heads: 7 cells of the font (font.h)
};

/// The colours that the pictures are made of.
class SurfacePaint {
 public:
  virtual ~SurfacePaint() = default;
  virtual const std::vector<Sign>& signs() const = 0;
  /// The mean colour, sRGB in 0..255, over about `texel` x `texel` metres around a point on the surface. The point is
  /// without the options' origin.
  virtual glm::dvec3 colorAt(const glm::dvec3& point, double texel) const = 0;
};
std::unique_ptr<SurfacePaint> makePaint(TexturedShape shape, std::uint64_t seed);
std::vector<Sign> signsOf(TexturedShape shape, std::uint64_t seed);

/// The files that writeTexturedObj() writes: NAME.obj, NAME.mtl, NAME_0.jpg, NAME_1.jpg, … in one folder. Errors:
/// kInvalidInput for a path that does not end in .obj, and for options outside their ranges.
base::Result<std::vector<std::string>> texturedFiles(const TexturedOptions& options, const std::string& path);

/// Writes all the files, which appear whole and together at the end, or not at all.
base::Result<void> writeTexturedObj(const TexturedOptions& options, const std::string& path,
                                    const std::function<bool(double done)>& progress = nullptr);

}  // namespace mesh::generate
