#include "repository/sampling/key.h"

#include <string>

namespace repository {
namespace {

constexpr unsigned kPointShift = kTileBits + 3;
constexpr unsigned kPointBits = 48;

// Moves bit i of a 16-bit index to bit 3 i (Morton 1966). Each of the four steps halves the distance that bits still
// have to move.
std::uint64_t spread(std::uint32_t index) {
  std::uint64_t bits = index & kMaxGridIndex;
  bits = (bits | bits << 16) & 0x0000FF0000FFULL;
  bits = (bits | bits << 8) & 0x00F00F00F00FULL;
  bits = (bits | bits << 4) & 0x0C30C30C30C3ULL;
  return (bits | bits << 2) & 0x249249249249ULL;
}

// Inverts spread().
std::uint32_t gather(std::uint64_t bits) {
  bits &= 0x249249249249ULL;
  bits = (bits | bits >> 2) & 0x0C30C30C30C3ULL;
  bits = (bits | bits >> 4) & 0x00F00F00F00FULL;
  bits = (bits | bits >> 8) & 0x0000FF0000FFULL;
  return static_cast<std::uint32_t>(bits | bits >> 16) & kMaxGridIndex;
}

}  // namespace

std::uint64_t FaceKey::code() const {
  const std::uint64_t morton = spread(x) | spread(y) << 1 | spread(z) << 2;
  return morton << kPointShift | std::uint64_t{d & 7U} << kTileBits | (tile & ((1U << kTileBits) - 1));
}

base::Result<FaceKey> FaceKey::fromCode(std::uint64_t code) {
  const std::uint64_t morton = code >> kPointShift;
  const auto d = static_cast<std::uint32_t>(code >> kTileBits & 7U);
  const auto tile = static_cast<std::uint32_t>(code & ((1U << kTileBits) - 1));
  if (d > 5 || tile >= kTileNumbers || morton >> kPointBits != 0) {
    return base::Error{base::ErrorCode::kInvalidInput,
                       "face key " + std::to_string(code) + " has no valid direction, tile or grid point"};
  }
  return FaceKey{gather(morton), gather(morton >> 1), gather(morton >> 2), d, tile};
}

std::string nameOf(const FaceKey& key) {
  const std::string face = "face (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " +
                           std::to_string(key.z) + ", " + std::to_string(key.d) + ")";
  return key.tile == 0 ? face : "tile " + std::to_string(key.tile) + " of " + face;
}

}  // namespace repository
