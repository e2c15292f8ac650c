#pragma once
// The regular grid of sampling points around the model (Okamoto 2011, section 4.3).
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/geometry.h"
#include "repository/sampling/key.h"

namespace repository {

/// The points lie at first + spacing · (x, y, z), 0 ≤ index < count, in scene-local units.
struct Grid {
  glm::vec3 first{0.0F};
  float spacing = 1.0F;
  glm::uvec3 count{0};          ///< points along each axis, each ≥ 2 (0: no repository)
  std::uint32_t face_size = 0;  ///< pixels along one side of a face, where it is finest
  /// Depth of the finest tiles (tile.h): face_size is kTileCore · 2^tile_depth then. 0: a face is one plain image of
  /// face_size × face_size pixels.
  std::uint32_t tile_depth = 0;

  /// Whether faces are pyramids of tiles.
  bool isTiled() const { return tile_depth > 0; }
  /// Pixels along one side of a stored image.
  std::uint32_t imageSide() const { return isTiled() ? kTileSide : face_size; }
  /// Pixels along one side of a face made of the tiles of this depth.
  std::uint32_t faceSideAt(std::uint32_t depth) const { return isTiled() ? kTileCore << depth : face_size; }

  glm::vec3 point(std::uint32_t x, std::uint32_t y, std::uint32_t z) const {
    return first + spacing * glm::vec3(x, y, z);
  }
  std::uint64_t pointCount() const { return std::uint64_t{count.x} * count.y * count.z; }
  std::uint64_t faceCount() const { return 6 * pointCount(); }
  bool contains(const FaceKey& key) const {
    return key.x < count.x && key.y < count.y && key.z < count.z && key.d < 6 && key.tile < firstTileOf(tile_depth + 1);
  }

  /// The lower corner (x, y, z) of the cell that holds p, clamped so that all 8 corners exist.
  glm::uvec3 cellOf(const glm::vec3& p) const;
  /// The 8 corners of the cell that holds p.
  std::array<glm::uvec3, 8> cellCorners(const glm::vec3& p) const;

  void encode(base::ByteWriter& out) const;
  static base::Result<Grid> decode(base::ByteReader& in);  ///< refuses NaN, zero spacing, counts out of range
  friend bool operator==(const Grid&, const Grid&) = default;
};

/// Covers the viewing box, which is the model's box grown on every side by `margin` times its longest side (the paper
/// uses 0.5: a box twice as large along the longest side), with `points_per_longest_side` ≥ 2 sampling points along the
/// longest side and at least as dense ones along the others.
Grid makeGrid(const base::Aabb& model, std::uint32_t points_per_longest_side, float margin, std::uint32_t face_size);

/// The same grid with faces that are pyramids of tiles down to `depth`, 1 … kMaxTileDepth.
Grid withTiles(Grid grid, std::uint32_t depth);

/// The code of a point's first key: codes of points ascend in Morton order.
inline std::uint64_t codeOfPoint(const glm::uvec3& point) {
  return FaceKey{point.x, point.y, point.z, 0}.code();
}

/// The lower corner of child c of a cube at `corner`; the children are cubes of side `half` in Morton order.
inline glm::uvec3 childCorner(const glm::uvec3& corner, std::uint32_t half, std::uint32_t c) {
  return corner + half * glm::uvec3(c & 1U, c >> 1 & 1U, c >> 2);
}

/// Every grid point in Morton order.
std::vector<glm::uvec3> pointsInMortonOrder(const Grid& grid);

}  // namespace repository
