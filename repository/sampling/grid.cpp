#include "repository/sampling/grid.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/check.h"

namespace repository {
namespace {

constexpr std::uint32_t kMaxCount = kMaxGridIndex + 1;
constexpr std::uint32_t kMaxFaceSize = 16384;  // pixels; decodeJpeg and decodeCoverage accept no larger side

// The index of the cell that holds coordinate p along one axis, clamped to the grid. NaN gives 0.
std::uint32_t cellIndex(float p, float first, float spacing, std::uint32_t count) {
  const std::uint32_t last = count >= 2 ? count - 2 : 0;
  const float at = (p - first) / spacing;
  if (!(at > 0.0F)) return 0;
  return at >= static_cast<float>(last) ? last : static_cast<std::uint32_t>(at);
}

// Visits the octree of points depth first with children in Morton order, which needs neither sorting nor codes.
void visitInMortonOrder(const glm::uvec3& corner, std::uint32_t side, const glm::uvec3& count,
                        std::vector<glm::uvec3>& out) {
  if (corner.x >= count.x || corner.y >= count.y || corner.z >= count.z) return;
  if (side == 1) {
    out.push_back(corner);
    return;
  }
  const std::uint32_t half = side / 2;
  for (std::uint32_t child = 0; child < 8; ++child) {
    visitInMortonOrder(childCorner(corner, half, child), half, count, out);
  }
}

base::Error badGrid(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "grid: " + problem};
}

bool finite(const glm::vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

}  // namespace

glm::uvec3 Grid::cellOf(const glm::vec3& p) const {
  return {cellIndex(p.x, first.x, spacing, count.x), cellIndex(p.y, first.y, spacing, count.y),
          cellIndex(p.z, first.z, spacing, count.z)};
}

std::array<glm::uvec3, 8> Grid::cellCorners(const glm::vec3& p) const {
  const glm::uvec3 lower = cellOf(p);
  std::array<glm::uvec3, 8> corners;
  for (std::uint32_t i = 0; i < 8; ++i) corners[i] = lower + glm::uvec3(i & 1U, i >> 1 & 1U, i >> 2);
  return corners;
}

void Grid::encode(base::ByteWriter& out) const {
  for (int axis = 0; axis < 3; ++axis) out.f32(first[axis]);
  out.f32(spacing);
  for (int axis = 0; axis < 3; ++axis) out.u32(count[axis]);
  out.u32(face_size);
  out.u32(tile_depth);
}

base::Result<Grid> Grid::decode(base::ByteReader& in) {
  Grid grid;
  for (int axis = 0; axis < 3; ++axis) grid.first[axis] = in.f32();
  grid.spacing = in.f32();
  for (int axis = 0; axis < 3; ++axis) grid.count[axis] = in.u32();
  grid.face_size = in.u32();
  grid.tile_depth = in.u32();
  if (!in.ok()) return badGrid("cut short");

  if (!finite(grid.first) || !std::isfinite(grid.spacing) || grid.spacing <= 0.0F)
    return badGrid("a position or the spacing is not a usable number");
  if (grid.count == glm::uvec3(0)) return grid;  // the scene has no repository

  for (int axis = 0; axis < 3; ++axis) {
    if (grid.count[axis] < 2 || grid.count[axis] > kMaxCount)
      return badGrid("count " + std::to_string(grid.count[axis]) + " is not within 2.." + std::to_string(kMaxCount));
  }
  if (!finite(grid.point(grid.count.x - 1, grid.count.y - 1, grid.count.z - 1)))
    return badGrid("its last point is not finite");
  if (grid.face_size < 1 || grid.face_size > kMaxFaceSize)
    return badGrid("face size " + std::to_string(grid.face_size) + " is not within 1.." + std::to_string(kMaxFaceSize));
  if (grid.tile_depth > kMaxTileDepth || (grid.isTiled() && grid.face_size != kTileCore << grid.tile_depth))
    return badGrid("tiles of depth " + std::to_string(grid.tile_depth) + " do not make faces of " +
                   std::to_string(grid.face_size) + " pixels");
  return grid;
}

Grid makeGrid(const base::Aabb& model, std::uint32_t points_per_longest_side, float margin, std::uint32_t face_size) {
  LUMIGRID_CHECK(!model.empty());
  LUMIGRID_CHECK_LE(2U, points_per_longest_side);
  LUMIGRID_CHECK_LE(points_per_longest_side, kMaxCount);
  LUMIGRID_CHECK_LE(0.0F, margin);

  // The viewing box. A model without extent (one point) gets a box of side 1.
  const double model_longest = model.longest();
  const glm::dvec3 center = 0.5 * (glm::dvec3(model.min) + glm::dvec3(model.max));
  glm::dvec3 side = glm::dvec3(model.size()) + glm::dvec3(2.0 * static_cast<double>(margin) * model_longest);
  if (model_longest <= 0.0) side = glm::dvec3(1.0);
  const double longest = std::max({side.x, side.y, side.z});

  // The longest side fixes the spacing; along the others the points cover the box and are centred on it.
  Grid grid;
  const double spacing = longest / static_cast<double>(points_per_longest_side - 1);
  glm::dvec3 first;
  for (int axis = 0; axis < 3; ++axis) {
    // The 1e-6 keeps rounding from adding a step to a side as long as the longest.
    const double steps = std::ceil(side[axis] / spacing - 1e-6);
    grid.count[axis] = std::clamp(static_cast<std::uint32_t>(std::max(steps, 1.0)) + 1, 2U, points_per_longest_side);
    first[axis] = center[axis] - 0.5 * spacing * static_cast<double>(grid.count[axis] - 1);
  }
  grid.first = glm::vec3(first);
  grid.spacing = static_cast<float>(spacing);
  grid.face_size = face_size;
  return grid;
}

Grid withTiles(Grid grid, std::uint32_t depth) {
  LUMIGRID_CHECK(depth >= 1 && depth <= kMaxTileDepth);
  grid.tile_depth = depth;
  grid.face_size = kTileCore << depth;
  return grid;
}

std::vector<glm::uvec3> pointsInMortonOrder(const Grid& grid) {
  std::vector<glm::uvec3> points;
  points.reserve(static_cast<std::size_t>(grid.pointCount()));
  std::uint32_t side = 1;
  while (side < std::max({grid.count.x, grid.count.y, grid.count.z})) side *= 2;
  visitInMortonOrder(glm::uvec3(0), side, grid.count, points);
  return points;
}

}  // namespace repository
