#include "lod/patch/codec/low_bits.h"

#include <cstdint>

namespace lod::patch::codec {

namespace {

bool hasBits(const Uint4& q, std::uint32_t mask) {
  return ((q[0] | q[1] | q[2]) & mask) != 0;
}

}  // namespace

std::size_t countLowBits(std::span<const Uint4> positions, int bits) {
  const std::uint32_t mask = (1U << bits) - 1;
  std::size_t count = 0;
  for (const Uint4& q : positions.subspan(1)) count += hasBits(q, mask) ? 1 : 0;
  return count;
}

void writeLowBits(base::ByteWriter& out, std::span<const Uint4> positions, int bits) {
  const std::uint32_t mask = (1U << bits) - 1;
  base::Bytes which((positions.size() + 7) / 8, 0);
  base::Bytes packed((3 * static_cast<std::size_t>(bits) * positions.size() + 7) / 8 + 8, 0);
  std::size_t bit = 0;
  for (std::size_t v = 1; v < positions.size(); ++v) {
    const Uint4& q = positions[v];
    if (!hasBits(q, mask)) continue;
    which[v / 8] = static_cast<std::uint8_t>(which[v / 8] | 1U << v % 8);
    std::uint64_t low = 0;
    for (int axis = 2; axis >= 0; --axis) low = low << bits | (q[axis] & mask);
    store64(&packed[bit / 8], load64(&packed[bit / 8]) | low << bit % 8);
    bit += 3 * static_cast<std::size_t>(bits);
  }
  packed.resize((bit + 7) / 8);
  out.bytes(which);
  out.bytes(packed);
}

bool readLowBits(base::ByteView in, std::size_t& at, int bits, std::span<Uint4> low) {
  const std::size_t marks = (low.size() + 7) / 8;
  if (in.size() - at < marks) return false;
  const std::uint8_t* which = in.data() + at;
  if ((which[0] & 1U) != 0 || which[marks - 1] >> ((low.size() - 1) % 8 + 1) != 0) return false;
  at += marks;

  const std::uint32_t mask = (1U << bits) - 1;
  const std::size_t end = 8 * in.size();
  std::size_t bit = 8 * at;
  for (std::size_t v = 0; v < low.size(); ++v) {
    low[v] = Uint4{};
    if ((which[v / 8] >> v % 8 & 1U) == 0) continue;
    if (bit + 3 * static_cast<std::size_t>(bits) > end) return false;
    std::uint64_t word = load64(in.data() + bit / 8) >> bit % 8;
    bit += 3 * static_cast<std::size_t>(bits);
    for (int axis = 0; axis < 3; ++axis, word >>= bits) low[v][axis] = static_cast<std::uint32_t>(word) & mask;
  }
  at = (bit + 7) / 8;
  return bit % 8 == 0 || in[at - 1] >> bit % 8 == 0;
}

}  // namespace lod::patch::codec
