#pragma once
// The tiles of a face: a pyramid of square images, each of which shows a quarter of the one above it
// (docs/formats/repository.md, "Tiles").
//
// Tiles are numbered as a quadtree in breadth-first order, each level in Morton order: 0 is the whole face, and the
// children of n are 4 n + 1 … 4 n + 4. A tile of depth l has as many pixels as any other, so at depth l a face is
// 2^l times as fine as its tile 0.
#include <cstdint>

namespace repository {

/// Pixels along one side of a tile's image. It shows kTileCore pixels of its own, and on every side kTileBorder more
/// that belong to its neighbours, so that filters at its edge find the same pixels as in the neighbour.
inline constexpr std::uint32_t kTileSide = 256;
inline constexpr std::uint32_t kTileBorder = 4;
inline constexpr std::uint32_t kTileCore = kTileSide - 2 * kTileBorder;
/// Depth of the finest tiles that a key can name.
inline constexpr std::uint32_t kMaxTileDepth = 5;

/// The number of the first tile of a depth; all of lesser depth have smaller numbers.
constexpr std::uint32_t firstTileOf(std::uint32_t depth) {
  return ((1U << (2 * depth)) - 1) / 3;
}
inline constexpr std::uint32_t kTileNumbers = firstTileOf(kMaxTileDepth + 1);

/// A tile by its depth and its place among the 2^depth × 2^depth tiles there: x counts from the left, y from the top.
struct TilePlace {
  std::uint32_t depth = 0, x = 0, y = 0;
  friend bool operator==(const TilePlace&, const TilePlace&) = default;
};
TilePlace placeOfTile(std::uint32_t tile);
std::uint32_t tileAt(const TilePlace& place);

/// Undefined for tile 0.
constexpr std::uint32_t parentOfTile(std::uint32_t tile) {
  return (tile - 1) / 4;
}
/// Child c, 0..3, lies at (2 x + (c & 1), 2 y + (c >> 1)).
constexpr std::uint32_t childOfTile(std::uint32_t tile, std::uint32_t c) {
  return 4 * tile + 1 + c;
}

}  // namespace repository
