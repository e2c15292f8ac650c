#pragma once
// Tells whether a face is whole: its tile 0 is stored, and every tile that a stored one names as its child.
#include <bitset>
#include <cstdint>
#include <vector>

#include "repository/sampling/tile.h"

namespace repository {

/// The stored tiles of one face, which are added in ascending order.
class FaceTiles {
 public:
  /// `children`: as FaceValue::children. False when no tile that was added names this one, nor is it tile 0: it belongs
  /// to no face, and neither do its descendants.
  bool add(std::uint32_t tile, std::uint8_t children);
  bool isWhole() const { return present_[0] && present_ == named_; }
  /// The tiles that others name and that were not added, ascending; tile 0 too.
  std::vector<std::uint32_t> missing() const;

 private:
  // The places behind the last tile are children that no key can name, so a tile that claims to have them is not whole.
  static constexpr std::size_t kPlaces = std::size_t{childOfTile(kTileNumbers - 1, 3)} + 1;
  std::bitset<kPlaces> named_{1};
  std::bitset<kPlaces> present_;
};

}  // namespace repository
