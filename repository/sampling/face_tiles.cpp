#include "repository/sampling/face_tiles.h"

#include "base/check.h"

namespace repository {

bool FaceTiles::add(std::uint32_t tile, std::uint8_t children) {
  LUMIGRID_CHECK_LT(tile, kTileNumbers);
  if (!named_[tile]) return false;
  present_.set(tile);
  for (std::uint32_t c = 0; c < 4; ++c)
    if ((children >> c & 1U) != 0) named_.set(childOfTile(tile, c));
  return true;
}

std::vector<std::uint32_t> FaceTiles::missing() const {
  std::vector<std::uint32_t> tiles;
  const auto absent = named_ & ~present_;
  for (std::size_t tile = 0; tile < kPlaces; ++tile)
    if (absent[tile]) tiles.push_back(static_cast<std::uint32_t>(tile));
  return tiles;
}

}  // namespace repository
