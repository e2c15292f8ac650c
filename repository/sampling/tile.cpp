#include "repository/sampling/tile.h"

#include "base/check.h"

namespace repository {

TilePlace placeOfTile(std::uint32_t tile) {
  LUMIGRID_CHECK_LT(tile, kTileNumbers);
  TilePlace place;
  while (tile >= firstTileOf(place.depth + 1)) ++place.depth;
  const std::uint32_t morton = tile - firstTileOf(place.depth);
  for (std::uint32_t bit = 0; bit < place.depth; ++bit) {
    place.x |= (morton >> (2 * bit) & 1U) << bit;
    place.y |= (morton >> (2 * bit + 1) & 1U) << bit;
  }
  return place;
}

std::uint32_t tileAt(const TilePlace& place) {
  LUMIGRID_CHECK_LE(place.depth, kMaxTileDepth);
  LUMIGRID_CHECK_LT(place.x | place.y, 1U << place.depth);
  std::uint32_t morton = 0;
  for (std::uint32_t bit = 0; bit < place.depth; ++bit)
    morton |= (place.x >> bit & 1U) << (2 * bit) | (place.y >> bit & 1U) << (2 * bit + 1);
  return firstTileOf(place.depth) + morton;
}

}  // namespace repository
