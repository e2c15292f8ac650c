#pragma once
// Cuts a face that was drawn at its finest into a pyramid of tiles, and chooses the tiles that are worth storing
// (docs/formats/repository.md, "Tiles").
#include <array>
#include <cstdint>
#include <vector>

#include "base/image.h"
#include "repository/sampling/tile.h"

namespace server {

/// A tile is left out where its parent shows the same within this root mean square difference: premultiplied red,
/// green, blue and alpha, each 0..255, over the pixels of the tile's core where either shows anything. Coding at
/// quality 85 costs about as much (docs/decisions/tiles.md).
inline constexpr double kTileThreshold = 2.0;

/// The levels of one face. Level l shows the face in 248 · 2^l pixels along a side, and 4 · 2^l more around them.
class FacePyramid {
 public:
  /// `finest`: the picture of repository::wholeFaceCamera(), which must outlive the pyramid; depth: 1 …
  /// repository::kMaxTileDepth.
  FacePyramid(const base::Image& finest, std::uint32_t depth);

  std::uint32_t depth() const { return static_cast<std::uint32_t>(coarser_.size()); }
  /// The image of a tile, kTileSide pixels along a side, its border included.
  base::Image imageOf(std::uint32_t tile) const;
  /// How far a tile's core differs from what its parent shows of it, as kTileThreshold says. Not for tile 0.
  double differenceFromParent(std::uint32_t tile) const;
  /// Tells whether any pixel of the tile's image is stored as model.
  bool showsModel(std::uint32_t tile) const;

 private:
  const base::Image& level(std::uint32_t l) const { return l == depth() ? finest_ : coarser_[l]; }

  const base::Image& finest_;
  std::vector<base::Image> coarser_;  // levels 0 … depth − 1
  // By level 1 … depth, row by row: 1 where any of a block's pixels is stored as model.
  std::vector<std::vector<std::uint8_t>> model_;
};

/// The tiles to store, each with its children that are stored too.
struct ChosenTile {
  std::uint32_t tile = 0;
  std::uint8_t children = 0;  ///< as repository::FaceValue::children
  friend bool operator==(const ChosenTile&, const ChosenTile&) = default;
};

/// Chooses tile 0, and each tile that shows model and differs from its parent by more than `threshold`, with all its
/// ancestors. Ascending by tile. `wanted`: ascending numbers, those of all ancestors among them, of which only are
/// chosen; null: all.
std::vector<ChosenTile> chooseTiles(const FacePyramid& pyramid, double threshold = kTileThreshold,
                                    const std::vector<std::uint32_t>* wanted = nullptr);

}  // namespace server
