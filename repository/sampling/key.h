#pragma once
// The key of one stored face: a grid point and a direction (Okamoto 2011, section 4.3: (xi, yi, zi, d)).
#include <compare>
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"

namespace repository {

/// The largest index of a grid point along one axis. 20 bits an axis leave room for d in a 64-bit code.
inline constexpr std::uint32_t kMaxGridIndex = (1U << 20) - 1;

struct FaceKey {
  std::uint32_t x = 0, y = 0, z = 0;  ///< grid point, 0 … kMaxGridIndex
  std::uint32_t d = 0;                ///< 0..5: +x −x +y −y +z −z

  /// The Morton code of (x, y, z) in the upper bits and d in the lowest 3, so that neighbours in space are neighbours
  /// in the store.
  std::uint64_t code() const;
  static base::Result<FaceKey> fromCode(std::uint64_t code);  ///< error when d > 5 or high bits are set

  friend bool operator==(const FaceKey&, const FaceKey&) = default;
  friend auto operator<=>(const FaceKey& a, const FaceKey& b) { return a.code() <=> b.code(); }
};

/// The key as messages name it: "face (3, 0, 7, 5)".
std::string nameOf(const FaceKey& key);

}  // namespace repository

template <>
struct std::hash<repository::FaceKey> {
  std::size_t operator()(const repository::FaceKey& key) const noexcept {
    return std::hash<std::uint64_t>{}(key.code());
  }
};
