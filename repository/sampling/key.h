#pragma once
// The key of one stored image: a grid point, a direction (Okamoto 2011, section 4.3: (xi, yi, zi, d)) and a tile of
// that face (tile.h).
#include <compare>
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "repository/sampling/tile.h"

namespace repository {

/// The largest index of a grid point along one axis. 16 bits an axis leave room for d and a tile in a 64-bit code.
inline constexpr std::uint32_t kMaxGridIndex = (1U << 16) - 1;

/// The lowest bits of a key's code, which hold the tile.
inline constexpr unsigned kTileBits = 11;
static_assert(kTileNumbers <= 1U << kTileBits);

struct FaceKey {
  std::uint32_t x = 0, y = 0, z = 0;  ///< grid point, 0 … kMaxGridIndex
  std::uint32_t d = 0;                ///< 0..5: +x −x +y −y +z −z
  std::uint32_t tile = 0;             ///< number in the face's pyramid; 0: the whole face in one image

  /// The Morton code of (x, y, z) in the upper bits, then d in three bits and the tile in the lowest eleven, so that
  /// neighbours in space are neighbours in the store, and a face's tiles lie side by side.
  std::uint64_t code() const;
  static base::Result<FaceKey> fromCode(std::uint64_t code);  ///< error when d, the tile or high bits are out of range

  /// The face that the tile is a part of, as a key of its first tile.
  FaceKey face() const { return {x, y, z, d}; }

  friend bool operator==(const FaceKey&, const FaceKey&) = default;
  friend auto operator<=>(const FaceKey& a, const FaceKey& b) { return a.code() <=> b.code(); }
};

/// The key as messages name it: "face (3, 0, 7, 5)", "tile 12 of face (3, 0, 7, 5)".
std::string nameOf(const FaceKey& key);

}  // namespace repository

template <>
struct std::hash<repository::FaceKey> {
  std::size_t operator()(const repository::FaceKey& key) const noexcept {
    return std::hash<std::uint64_t>{}(key.code());
  }
};
