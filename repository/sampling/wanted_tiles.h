#pragma once
// The tiles that are to be stored where they were chosen by use (docs/formats/repository.md, "Tiles by use").
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"

namespace repository {

/// A set of tiles, which holds tile 0 of every face, and with each tile all its ancestors.
class WantedTiles {
 public:
  WantedTiles() = default;
  /// In any order, also more than once.
  explicit WantedTiles(const std::vector<FaceKey>& keys);

  bool has(const FaceKey& key) const;
  /// The wanted tiles of one face, ascending, 0 among them.
  std::vector<std::uint32_t> ofFace(const FaceKey& face) const;
  /// How many they are, those with number 0 not counted.
  std::size_t count() const { return codes_.size(); }

  base::Bytes encode(const Grid& grid) const;
  /// Hostile bytes give an error and never take more than 64 times their own memory.
  static base::Result<WantedTiles> decode(const Grid& grid, base::ByteView bytes);

  friend bool operator==(const WantedTiles&, const WantedTiles&) = default;

 private:
  std::vector<std::uint64_t> codes_;  // of keys but those of tile 0, ascending
};

}  // namespace repository
