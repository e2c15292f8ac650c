#pragma once
// Cuts a surface's sheets into charts and places them in pictures.
#include "mesh/generate/textured_surface.h"

namespace mesh::generate {

/// A rectangle of a sheet's quads, and where it lies in a picture.
struct Chart {
  std::uint32_t sheet = 0;
  std::uint32_t left = 0, right = 0, bottom = 0, top = 0;  // lines of the sheet
  bool turned = false;                                     ///< by 90 degrees, counterclockwise
  bool mirrored = false;                                   ///< left and right are exchanged, after the turn
  std::uint32_t picture = 0;
  glm::ivec2 place{0};         ///< the first texel of its padding, from the picture's left and top
  glm::dvec2 low{0.0};         ///< its lower left corner in the sheet, in metres
  glm::dvec2 size{0.0};        ///< in metres of the sheet
  std::uint64_t first_uv = 0;  ///< of its texture coordinates in the file, row by row from below
  std::uint32_t columns() const { return right - left; }
  std::uint32_t rows() const { return top - bottom; }
};

struct Atlas {
  AtlasStyle style;
  double density = 1.0;              ///< texels for a metre
  std::vector<Chart> charts;         ///< those of a picture stand together
  std::vector<glm::ivec2> pictures;  ///< width and height in texels

  /// Texels that a chart takes up, padding included.
  glm::ivec2 extent(const Chart& chart) const;
  /// Texels from the picture's left and top, for a point of the sheet in metres.
  glm::dvec2 pictureFromSheet(const Chart& chart, const glm::dvec2& st) const;
  glm::dvec2 sheetFromPicture(const Chart& chart, const glm::dvec2& at) const;
};

/// `texels` is the number of texels for a triangle. Errors: kInvalidInput for more pictures than are written.
base::Result<Atlas> makeAtlas(const TexturedSurface& surface, std::uint64_t texels);

}  // namespace mesh::generate
