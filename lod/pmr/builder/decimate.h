#pragma once
// Decimation by radius and height of Voronoi cells (Dey and Hudson 2002, section 2, "Point hierarchy").
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "lod/pmr/builder/surroundings.h"
#include "lod/pmr/builder/voronoi.h"

namespace lod::pmr::builder {

/// Returns the class of each own point: the coarsest level that it is part of. For each level in turn the point of the
/// least ratio is deleted until none is below the level's threshold; the polygons of its neighbours grow at once. The
/// height stays that of all points: it measures the shape, and the denser the points, the better. Points at a rim stay.
///
/// The ratio is r / sqrt(h l), of the cell's radius r, height h, and height limit l. A polygon of radius r on a part
/// of height h is about r^2 / 2h deep, so that a threshold bounds the depth by rho^2 l / 2, whatever the height, l
/// being a number of spacings. The paper's r / h bounds it by the height of the part: at equal numbers the mesh is
/// farther from such levels than from points thinned evenly (docs/decisions/pmr.md).
///
/// The others are treated alike, as far as the block knows, and so, nearly always, as their own block treats them.
std::vector<std::uint8_t> decimate(const PointBlock& block, const Neighbourhoods& near,
                                   std::span<const VoronoiCell> cells);

}  // namespace lod::pmr::builder
