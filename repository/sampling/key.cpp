#include "repository/sampling/key.h"

#include <string>

namespace repository {
namespace {

constexpr std::uint64_t kEveryThird = 0x1249249249249249ULL;

// Moves bit i of a 20-bit index to bit 3 i (Morton 1966). Each of the five steps halves the distance that bits still
// have to move.
std::uint64_t spread(std::uint32_t index) {
  std::uint64_t bits = index & kMaxGridIndex;
  bits = (bits | bits << 32) & 0x001F00000000FFFFULL;
  bits = (bits | bits << 16) & 0x001F0000FF0000FFULL;
  bits = (bits | bits << 8) & 0x100F00F00F00F00FULL;
  bits = (bits | bits << 4) & 0x10C30C30C30C30C3ULL;
  return (bits | bits << 2) & kEveryThird;
}

// Inverts spread().
std::uint32_t gather(std::uint64_t bits) {
  bits &= kEveryThird;
  bits = (bits | bits >> 2) & 0x10C30C30C30C30C3ULL;
  bits = (bits | bits >> 4) & 0x100F00F00F00F00FULL;
  bits = (bits | bits >> 8) & 0x001F0000FF0000FFULL;
  bits = (bits | bits >> 16) & 0x001F00000000FFFFULL;
  return static_cast<std::uint32_t>(bits | bits >> 32) & kMaxGridIndex;
}

}  // namespace

std::uint64_t FaceKey::code() const {
  const std::uint64_t morton = spread(x) | spread(y) << 1 | spread(z) << 2;
  return morton << 3 | (d & 7U);
}

base::Result<FaceKey> FaceKey::fromCode(std::uint64_t code) {
  const std::uint64_t morton = code >> 3;
  const auto d = static_cast<std::uint32_t>(code & 7U);
  if (d > 5 || morton >> 60 != 0) {
    return base::Error{base::ErrorCode::kInvalidInput,
                       "face key " + std::to_string(code) + " has no valid direction or grid point"};
  }
  return FaceKey{gather(morton), gather(morton >> 1), gather(morton >> 2), d};
}

std::string nameOf(const FaceKey& key) {
  return "face (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " + std::to_string(key.z) + ", " +
         std::to_string(key.d) + ")";
}

}  // namespace repository
