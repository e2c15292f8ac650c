#include "lod/patch/codec/residual_reader.h"

#include <array>
#include <bit>
#include <cstring>

#include "lod/patch/codec/processors.h"
#include "lod/patch/codec/residuals.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace lod::patch::codec {
namespace {

// Where the parts of a plane are.
struct PlaneParts {
  const std::uint8_t* widths = nullptr;
  const std::uint8_t* low = nullptr;
  const std::uint8_t* unary = nullptr;
  std::size_t unary_bytes = 0;

  std::uint32_t width(std::size_t group) const { return widths[group / 2] >> (4 * (group % 2)) & 15U; }
};

// The bytes of low bits of sixteen groups, from their widths in nibbles: sums within one register.
constexpr std::size_t lowBytesOfSixteen(std::uint64_t widths) {
  constexpr std::uint64_t kNibbles = 0x0F0F0F0F0F0F0F0F, kSum = 0x0101010101010101;
  const std::uint64_t pairs = (widths & kNibbles) + (widths >> 4 & kNibbles);
  const std::uint64_t raw = widths & widths >> 1 & widths >> 2 & widths >> 3 & 0x1111111111111111;
  const std::uint64_t raw_pairs = (raw & kNibbles) + (raw >> 4 & kNibbles);
  return 2 * (pairs * kSum >> 56) + (64 - 2 * kRawWidth) * (raw_pairs * kSum >> 56);
}
static_assert(lowBytesOfSixteen(0xFFFFFFFFFFFFFFFF) == 16 * lowBytes(kRawWidth));
static_assert(lowBytesOfSixteen(0xF000000000000EF1) == 2 * lowBytes(kRawWidth) + lowBytes(14) + lowBytes(1));

// Sixteen widths of two bits as nibbles, `min_width` added to each.
LUMIGRID_ALWAYS_INLINE std::uint64_t nibblesOfPairs(std::uint32_t pairs, std::uint32_t min_width) {
  std::uint64_t x = pairs;
  x = (x | x << 16) & 0x0000FFFF0000FFFF;
  x = (x | x << 8) & 0x00FF00FF00FF00FF;
  x = (x | x << 4) & 0x0F0F0F0F0F0F0F0F;
  x = (x | x << 2) & 0x3333333333333333;
  return x + 0x1111111111111111U * min_width;
}

// Finds the parts of the plane at `at`, which moves behind it. False when the plane runs past the end.
LUMIGRID_ALWAYS_INLINE bool findPlane(base::ByteView in, std::size_t& at, std::size_t groups, std::uint8_t* widths,
                                      PlaneParts& plane) {
  if (in.size() - at < 3) return false;
  const std::uint32_t first = in[at] | std::uint32_t{in[at + 1]} << 8;
  const bool is_narrow = (first & kNarrowWidths) != 0;
  const std::size_t unary_bytes = first & (kNarrowWidths - 1);
  const std::uint32_t min_width = in[at + 2];
  if (is_narrow && min_width + kNarrowSpan > kRawWidth) return false;
  at += is_narrow ? 3 : 2;
  const std::size_t width_bytes = is_narrow ? (groups + 3) / 4 : (groups + 1) / 2;
  if (in.size() - at < width_bytes) return false;
  plane.widths = widths;
  std::size_t low_bytes = 0;
  for (std::size_t g = 0; g < groups; g += 16) {
    const std::uint64_t unused = groups - g < 16 ? ~std::uint64_t{0} << (4 * (groups - g)) : 0;
    const std::uint64_t sixteen =
        is_narrow ? nibblesOfPairs(load32(in.data() + at + g / 4), min_width) : load64(in.data() + at + g / 2);
    store64(widths + g / 2, sixteen);
    low_bytes += lowBytesOfSixteen(sixteen & ~unused);
  }
  at += width_bytes;
  if (in.size() - at < low_bytes + unary_bytes) return false;
  plane.low = in.data() + at;
  plane.unary = plane.low + low_bytes;
  plane.unary_bytes = unary_bytes;
  at += low_bytes + unary_bytes;
  return true;
}

// A group of width kRawWidth.
void readRaw(const std::uint8_t* low, std::uint32_t* out) {
  std::memcpy(out, low, 4 * kGroup);
  for (std::size_t i = 0; i < kGroup; ++i) out[i] = unzigzag(out[i]);
}

#if defined(__x86_64__)
// The places of the ones in each byte, lowest first.
constexpr auto kOnes = [] {
  std::array<std::array<std::uint8_t, 8>, 256> places{};
  for (std::size_t byte = 0; byte < 256; ++byte)
    for (std::size_t bit = 0, i = 0; bit < 8; ++bit)
      if ((byte >> bit & 1U) != 0) places[byte][i++] = static_cast<std::uint8_t>(bit);
  return places;
}();

// Writes the places of the ones in a plane's unary bits, modulo 256, behind places[0], and returns their count. It
// stops after `max_ones` and a few.
__attribute__((LUMIGRID_AVX2)) std::size_t findOnesByAvx2(const PlaneParts& plane, std::size_t max_ones,
                                                          std::uint8_t* places) {
  std::size_t ones = 0;
  __m128i first_bit = _mm_setzero_si128();
  for (std::size_t i = 0; i < plane.unary_bytes && ones < max_ones; i += 8) {
    std::uint64_t word = load64(plane.unary + i);
#pragma GCC unroll 8
    for (std::size_t k = 0; k < 8; ++k, word >>= 8) {
      const auto byte = static_cast<std::uint8_t>(word);
      const __m128i inside = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(kOnes[byte].data()));
      _mm_storel_epi64(reinterpret_cast<__m128i*>(places + 1 + ones), _mm_add_epi8(inside, first_bit));
      ones += static_cast<std::size_t>(_mm_popcnt_u32(byte));
      first_bit = _mm_add_epi8(first_bit, _mm_set1_epi8(8));
    }
  }
  return ones;
}

constexpr auto kAllPlaces = [] {
  std::array<std::uint8_t, 64> places{};
  for (std::size_t bit = 0; bit < 64; ++bit) places[bit] = static_cast<std::uint8_t>(bit);
  return places;
}();
// The same with 64 bits at a time.
__attribute__((target("avx512f,avx512bw,avx512vbmi2,popcnt"))) std::size_t findOnesByAvx512(const PlaneParts& plane,
                                                                                            std::size_t max_ones,
                                                                                            std::uint8_t* places) {
  std::size_t ones = 0;
  __m512i every = _mm512_loadu_si512(kAllPlaces.data());
  for (std::size_t i = 0; i < plane.unary_bytes && ones < max_ones; i += 8) {
    const std::uint64_t word = load64(plane.unary + i);
    _mm512_storeu_si512(places + 1 + ones, _mm512_maskz_compress_epi8(word, every));
    ones += static_cast<std::size_t>(_mm_popcnt_u64(word));
    every = _mm512_add_epi8(every, _mm512_set1_epi8(64));
  }
  return ones;
}

// A group at a time, when the places of all ones are known. Places are modulo 256, so that a group of 256 bits too many
// looks short: the sum of lengths at the end finds it.
using OnesFinder = std::size_t (*)(const PlaneParts& plane, std::size_t max_ones, std::uint8_t* places);
template <OnesFinder kFindOnes>
__attribute__((LUMIGRID_AVX2)) bool readByVectors(base::ByteView in, std::size_t& at, std::size_t groups,
                                                  const ResidualRoom& room, std::uint32_t* out) {
  PlaneParts plane;
  if (!findPlane(in, at, groups, room.widths, plane)) return false;
  std::uint8_t* const places = room.places;
  places[0] = 0xFF;
  const std::size_t ones = kFindOnes(plane, kGroup * groups, places);

  std::size_t bits = 0;
  std::size_t used = 0;
  for (std::size_t g = 0; g < groups; ++g, out += kGroup) {
    const std::uint32_t width = plane.width(g);
    if (width == kRawWidth) {
      readRaw(plane.low, out);
      plane.low += 64;
      continue;
    }
    // A number's upper part is the count of zeros between its one and the one before.
    const std::uint8_t* const here = places + used;
    const __m128i before = _mm_loadu_si128(reinterpret_cast<const __m128i*>(here));
    const __m128i after = _mm_loadu_si128(reinterpret_cast<const __m128i*>(here + 1));
    const __m128i zeros = _mm_sub_epi8(_mm_sub_epi8(after, before), _mm_set1_epi8(1));
    const auto length = static_cast<std::uint8_t>(here[kGroup] - here[0]);
    if (length > kMaxUnary) return false;
    bits += length;
    used += kGroup;
    if (used > ones) return false;

    const __m128i shift = _mm_cvtsi32_si128(static_cast<int>(width));
    __m256i low0, low8;
    if (width <= 8) {
      const std::uint64_t mask = ((std::uint64_t{1} << width) - 1) * 0x0101010101010101U;
      const auto eight = [&](const std::uint8_t* from) __attribute__((always_inline, LUMIGRID_AVX2)) {
        return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(_pdep_u64(load64(from), mask))));
      };
      low0 = eight(plane.low), low8 = eight(plane.low + width);
    } else {
      const std::uint64_t mask = ((std::uint64_t{1} << width) - 1) * 0x0001000100010001U;
      const auto eight = [&](std::size_t first) __attribute__((always_inline, LUMIGRID_AVX2)) {
        const auto four = [&](std::size_t i) __attribute__((always_inline, LUMIGRID_AVX2)) {
          const std::size_t low_bit = i * width;
          return static_cast<long long>(_pdep_u64(load64(plane.low + low_bit / 8) >> (low_bit % 8), mask));
        };
        return _mm256_cvtepu16_epi32(_mm_set_epi64x(four(first + 4), four(first)));
      };
      low0 = eight(0), low8 = eight(8);
    }
    const __m256i high0 = _mm256_sll_epi32(_mm256_cvtepu8_epi32(zeros), shift);
    const __m256i high8 = _mm256_sll_epi32(_mm256_cvtepu8_epi32(_mm_srli_si128(zeros, 8)), shift);
    const auto store = [](std::uint32_t * to, __m256i x) __attribute__((always_inline, LUMIGRID_AVX2)) {
      const __m256i sign = _mm256_sub_epi32(_mm256_setzero_si256(), _mm256_and_si256(x, _mm256_set1_epi32(1)));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(to), _mm256_xor_si256(_mm256_srli_epi32(x, 1), sign));
    };
    store(out, _mm256_or_si256(high0, low0));
    store(out + 8, _mm256_or_si256(high8, low8));
    plane.low += 2 * width;
  }
  return (bits + 7) / 8 == plane.unary_bytes;
}
#endif

}  // namespace

bool readResiduals(base::ByteView in, std::size_t& at, std::size_t groups, const ResidualRoom& room,
                   std::uint32_t* out) {
  PlaneParts plane;
  if (!findPlane(in, at, groups, room.widths, plane)) return false;
  std::size_t bit = 0;
  for (std::size_t g = 0; g < groups; ++g, out += kGroup) {
    const std::uint32_t width = plane.width(g);
    if (width == kRawWidth) {
      readRaw(plane.low, out);
      plane.low += 64;
      continue;
    }
    if (bit > 8 * plane.unary_bytes) return false;
    std::uint64_t ones = load64(plane.unary + bit / 8) >> (bit % 8);
    const std::uint64_t mask = (std::uint64_t{1} << width) - 1;
    std::uint32_t before = 0;
    for (std::size_t four = 0; four < kGroup; four += 4) {
      const std::size_t low_bit = four * width;
      std::uint64_t lows = load64(plane.low + low_bit / 8) >> (low_bit % 8);
      for (std::size_t i = 0; i < 4; ++i) {
        // The next one bit ends the number.
        if (ones == 0) return false;
        const auto one = static_cast<std::uint32_t>(std::countr_zero(ones));
        ones &= ones - 1;
        out[four + i] = unzigzag((one - before) << width | static_cast<std::uint32_t>(lows & mask));
        before = one + 1;
        lows >>= width;
      }
    }
    if (before > kMaxUnary) return false;
    plane.low += 2 * width;
    bit += before;
  }
  return (bit + 7) / 8 == plane.unary_bytes;
}

#if defined(__x86_64__)
__attribute__((LUMIGRID_AVX2)) bool readResidualsByAvx2(base::ByteView in, std::size_t& at, std::size_t groups,
                                                        const ResidualRoom& room, std::uint32_t* out) {
  return readByVectors<findOnesByAvx2>(in, at, groups, room, out);
}

__attribute__((LUMIGRID_AVX2)) bool readResidualsByAvx512(base::ByteView in, std::size_t& at, std::size_t groups,
                                                          const ResidualRoom& room, std::uint32_t* out) {
  return readByVectors<findOnesByAvx512>(in, at, groups, room, out);
}
#endif

}  // namespace lod::patch::codec
