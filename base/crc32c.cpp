#include "base/crc32c.h"

#include <array>
#include <cstring>

namespace base {
namespace {

constexpr std::uint32_t kPolynomial = 0x82F63B78;  // reversed 0x1EDC6F41, RFC 3720

// Eight tables fold eight bytes per step ("slicing by 8", Kounavis and Berry 2005).
constexpr auto makeTables() {
  std::array<std::array<std::uint32_t, 256>, 8> tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1U) != 0 ? kPolynomial : 0U);
    tables[0][i] = crc;
  }
  for (std::size_t t = 1; t < 8; ++t)
    for (std::size_t i = 0; i < 256; ++i) tables[t][i] = (tables[t - 1][i] >> 8) ^ tables[0][tables[t - 1][i] & 255U];
  return tables;
}
constexpr auto kTables = makeTables();

#if defined(__x86_64__)
// Three blocks are computed side by side: the instruction takes three cycles, and one can begin every cycle.
// A block's length is a choice: longer ones leave more to the plain loop, shorter ones join their states more often.
constexpr std::size_t kBlock = 256;

// Tables that advance a state over a block of zeros, one table per byte of the state.
constexpr auto makeBlockTables() {
  std::array<std::uint32_t, 32> of_bit{};
  for (std::size_t bit = 0; bit < 32; ++bit) {
    std::uint32_t crc = 1U << bit;
    for (std::size_t i = 0; i < kBlock; ++i) crc = (crc >> 8) ^ kTables[0][crc & 255U];
    of_bit[bit] = crc;
  }
  std::array<std::array<std::uint32_t, 256>, 4> tables{};
  for (std::size_t t = 0; t < 4; ++t)
    for (std::size_t value = 0; value < 256; ++value)
      for (std::size_t bit = 0; bit < 8; ++bit)
        if ((value >> bit & 1U) != 0) tables[t][value] ^= of_bit[8 * t + bit];
  return tables;
}
constexpr auto kBlockTables = makeBlockTables();

std::uint32_t afterBlock(std::uint64_t crc) {
  return kBlockTables[0][crc & 255U] ^ kBlockTables[1][(crc >> 8) & 255U] ^ kBlockTables[2][(crc >> 16) & 255U] ^
         kBlockTables[3][(crc >> 24) & 255U];
}

std::uint64_t wordAt(const std::uint8_t* at) {
  std::uint64_t word = 0;
  std::memcpy(&word, at, 8);
  return word;
}

// The instruction of SSE 4.2 computes the same polynomial.
__attribute__((target("sse4.2"))) std::uint32_t crcByInstruction(ByteView bytes, std::uint32_t seed) {
  std::uint64_t crc = ~seed;
  const std::uint8_t* at = bytes.data();
  std::size_t left = bytes.size();
  for (; left >= 3 * kBlock; left -= 3 * kBlock, at += 3 * kBlock) {
    std::uint64_t second = 0;
    std::uint64_t third = 0;
    for (std::size_t i = 0; i < kBlock; i += 8) {
      crc = __builtin_ia32_crc32di(crc, wordAt(at + i));
      second = __builtin_ia32_crc32di(second, wordAt(at + kBlock + i));
      third = __builtin_ia32_crc32di(third, wordAt(at + 2 * kBlock + i));
    }
    crc = afterBlock(afterBlock(crc) ^ second) ^ third;
  }
  for (; left >= 8; left -= 8, at += 8) crc = __builtin_ia32_crc32di(crc, wordAt(at));
  auto low = static_cast<std::uint32_t>(crc);
  for (; left > 0; --left, ++at) low = __builtin_ia32_crc32qi(low, *at);
  return ~low;
}
#endif

}  // namespace

std::uint32_t crc32cByTables(ByteView bytes, std::uint32_t seed) {
  std::uint32_t crc = ~seed;
  const std::uint8_t* at = bytes.data();
  std::size_t left = bytes.size();
  for (; left >= 8; left -= 8, at += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, at, 8);
    word ^= crc;
    crc = kTables[7][word & 255U] ^ kTables[6][(word >> 8) & 255U] ^ kTables[5][(word >> 16) & 255U] ^
          kTables[4][(word >> 24) & 255U] ^ kTables[3][(word >> 32) & 255U] ^ kTables[2][(word >> 40) & 255U] ^
          kTables[1][(word >> 48) & 255U] ^ kTables[0][word >> 56];
  }
  for (; left > 0; --left, ++at) crc = (crc >> 8) ^ kTables[0][(crc ^ *at) & 255U];
  return ~crc;
}

std::uint32_t crc32c(ByteView bytes, std::uint32_t seed) {
#if defined(__x86_64__)
  static const bool has_instruction = __builtin_cpu_supports("sse4.2") != 0;
  if (has_instruction) return crcByInstruction(bytes, seed);
#endif
  return crc32cByTables(bytes, seed);
}

}  // namespace base
