#include "lod/patch/codec.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "base/check.h"
#include "base/crc32c.h"

namespace lod::patch {
namespace {

constexpr std::uint8_t kCodecVersion = 4;
constexpr std::uint8_t kOldestVersion = 2;
constexpr std::uint8_t kHasColors = 1;
constexpr std::uint8_t kHasAlpha = 2;
constexpr std::uint8_t kIsRough = 4;
constexpr std::size_t kHeaderBytes = 32;
constexpr std::size_t kCrcOffset = 28;

// Vectors of four lanes; without vector registers the compiler takes them apart.
using Int4 = std::int32_t __attribute__((vector_size(16)));
using Uint4 = std::uint32_t __attribute__((vector_size(16)));
using Float4 = float __attribute__((vector_size(16)));

// Decoding is compiled twice, for any machine and for one with AVX2: everything on its way has to be inlined.
#define LUMIGRID_INLINE [[gnu::always_inline]] inline
// What is rare on a page's way through this file, the rest of which is built for speed there.
#if defined(__EMSCRIPTEN__)
#define LUMIGRID_RARE [[gnu::noinline]]
#else
#define LUMIGRID_RARE LUMIGRID_INLINE
#endif
#define LUMIGRID_AVX2 target("avx2,bmi,bmi2,popcnt")

struct PatchHeader {
  std::uint8_t version = kCodecVersion;
  std::uint8_t flags = 0;
  std::uint32_t vertices = 0;
  std::uint32_t triangles = 0;
  std::uint8_t facet_shift = 0;  // bits dropped from coordinates before facet normals are summed
  std::uint8_t front_bits = 0;   // the front's ring has 2^front_bits places
  glm::ivec3 corner{0};          // position of vertex 0
  std::uint32_t steps = 0;
  std::uint32_t escape_bytes = 0;
  std::uint32_t crc = 0;

  bool colored() const { return (flags & kHasColors) != 0; }
  bool alpha() const { return (flags & kHasAlpha) != 0; }
  // Places are predicted as a + ((b − opposite) >> shift): whole parallelograms, or half ones.
  int halving() const { return (flags & kIsRough) != 0 ? 1 : 0; }
  // Colours as (a + b + up) >> 1.
  std::uint32_t roundsUp() const { return version > 2 ? 1 : 0; }
  std::size_t stepBytes() const { return (std::size_t{steps} + 3) / 4; }
};

constexpr std::uint8_t kMaxFrontBits = 17;
constexpr std::uint8_t kMaxFacetShift = 31;

// Octahedral normals ------------------------------------------------------------------------------

// Many at once, coordinate by coordinate, so that the compiler vectorises it.
constexpr std::size_t kBlock = 64;
struct Unit {
  std::array<float, kBlock> x, y, z;
};

// In −127 … 127, halves away from zero.
LUMIGRID_INLINE std::int32_t toSnorm8(float x) {
  const float scaled = std::min(std::max(x, -1.0F), 1.0F) * 127.0F;
  const auto whole = static_cast<std::int32_t>(scaled);
  const auto to = static_cast<float>(whole);
  return whole + (scaled >= to + 0.5F ? 1 : 0) - (scaled <= to - 0.5F ? 1 : 0);
}

LUMIGRID_INLINE void encodeNormals(const Unit& in, std::size_t count, std::int32_t* codes_u, std::int32_t* codes_v) {
  for (std::size_t i = 0; i < count; ++i) {
    // Project onto the octahedron |x| + |y| + |z| = 1; a NaN anywhere makes the sum fail the test.
    const float sum = std::abs(in.x[i]) + std::abs(in.y[i]) + std::abs(in.z[i]);
    const bool good = sum > 0.0F && sum <= std::numeric_limits<float>::max();
    const float x = good ? in.x[i] / sum : 0.0F;
    const float y = good ? in.y[i] / sum : 0.0F;
    const float z = good ? in.z[i] : 0.0F;

    // Fold the lower half outwards.
    const float rest_x = 1.0F - std::abs(y);
    const float rest_y = 1.0F - std::abs(x);
    const float folded_x = x >= 0.0F ? rest_x : -rest_x;
    const float folded_y = y >= 0.0F ? rest_y : -rest_y;
    codes_u[i] = toSnorm8(z >= 0.0F ? x : folded_x);
    codes_v[i] = toSnorm8(z >= 0.0F ? y : folded_y);
  }
}

LUMIGRID_INLINE void decodeNormals(const std::int32_t* codes_u, const std::int32_t* codes_v, std::size_t count,
                                   Unit& out) {
  for (std::size_t i = 0; i < count; ++i) {
    // −128 means −127; integers until the fold is done, so that directions with two codes come out bit-equal.
    const std::int32_t u = std::max(codes_u[i], -127);
    const std::int32_t v = std::max(codes_v[i], -127);
    const std::int32_t z = 127 - std::abs(u) - std::abs(v);
    const std::int32_t folded_x = u >= 0 ? 127 - std::abs(v) : std::abs(v) - 127;
    const std::int32_t folded_y = v >= 0 ? 127 - std::abs(u) : std::abs(u) - 127;
    const auto x = static_cast<float>(z < 0 ? folded_x : u);
    const auto y = static_cast<float>(z < 0 ? folded_y : v);
    const auto w = static_cast<float>(z);
    // At most 3 · 127², exact however the compiler fuses it.
    const float inverse = 1.0F / std::sqrt(x * x + y * y + w * w);
    out.x[i] = x * inverse;
    out.y[i] = y * inverse;
    out.z[i] = w * inverse;
  }
}

// The code of a sum of facet normals, the same on every machine: no multiplication feeds an addition.
LUMIGRID_INLINE void predictNormals(const std::array<float, kBlock>& x, const std::array<float, kBlock>& y,
                                    const std::array<float, kBlock>& z, std::size_t count, std::int32_t* u,
                                    std::int32_t* v) {
  for (std::size_t i = 0; i < count; ++i) {
    const float ax = std::abs(x[i]);
    const float ay = std::abs(y[i]);
    const float az = std::abs(z[i]);
    const float sum_x = ax + az;
    const float sum_y = ay + az;
    const float total = sum_x + ay;
    const float total_y = sum_y + ax;
    const float along_x = z[i] < 0.0F ? sum_x : ax;
    const float along_y = z[i] < 0.0F ? sum_y : ay;
    const float a = 127.0F * along_x / (total > 0.0F ? total : 1.0F);
    const float b = 127.0F * along_y / (total_y > 0.0F ? total_y : 1.0F);
    const auto p = static_cast<std::int32_t>(a + 0.5F);
    const auto q = static_cast<std::int32_t>(b + 0.5F);
    u[i] = x[i] < 0.0F ? -p : p;
    v[i] = y[i] < 0.0F ? -q : q;
  }
}

// A vertex as facet normals need it: the point, and the sum of its facets' normals, lanes y, z, x.
struct alignas(32) Corner {
  Float4 point{};
  Float4 sum{};
};

// Adds facet normals, twice the area long, to the sums of their corners. Exact, in any order, when the encoder chose
// the shift; several runs of triangles in turn, since neighbours in one run wait for each other.
LUMIGRID_INLINE void sumFacets(const std::uint16_t* indices, std::size_t triangles, Corner* corners) {
  const auto add = [&](std::size_t t) __attribute__((always_inline)) {
    Corner& p = corners[indices[3 * t]];
    Corner& q = corners[indices[3 * t + 1]];
    Corner& r = corners[indices[3 * t + 2]];
    // Both edges turned round: the same product.
    const Float4 a = p.point - q.point;
    const Float4 b = p.point - r.point;
    const Float4 normal = a * __builtin_shufflevector(b, b, 1, 2, 0, 3) - __builtin_shufflevector(a, a, 1, 2, 0, 3) * b;
    p.sum += normal;
    q.sum += normal;
    r.sum += normal;
  };
  constexpr std::size_t kRuns = 8;
  const std::size_t run = triangles / kRuns;
  for (std::size_t t = 0; t < run; ++t)
    for (std::size_t r = 0; r < kRuns; ++r) add(r * run + t);
  for (std::size_t t = kRuns * run; t < triangles; ++t) add(t);
}

// Colours -----------------------------------------------------------------------------------------

// Levels per channel, then the reversible YCoCg of Malvar and Sullivan 2003 on them.
constexpr std::int32_t kColorLevels = 39;

// Of each channel's byte, rounded.
constexpr std::array<std::uint8_t, 256> kLevelOfByte = [] {
  std::array<std::uint8_t, 256> levels{};
  for (std::size_t c = 0; c < levels.size(); ++c)
    levels[c] = static_cast<std::uint8_t>((c * kColorLevels * 2 + 255) / 510);
  return levels;
}();

// Byte of a level, rounded.
constexpr std::int32_t kLevelScale = 255 * 65536 / kColorLevels + 1;

std::uint8_t levelByte(std::int32_t level) {
  return static_cast<std::uint8_t>((level * kLevelScale + 32768) >> 16);
}

LUMIGRID_INLINE Int4 levelBytes(Int4 level) {
  // Hostile levels are clamped.
  level = level < 0 ? Int4{} : level;
  level = level > kColorLevels ? Int4{} + kColorLevels : level;
  return (level * kLevelScale + 32768) >> 16;
}

Int4 colorCode(const glm::u8vec4& c) {
  const std::int32_t red = kLevelOfByte[c.r], blue = kLevelOfByte[c.b];
  const std::int32_t orange = red - blue;
  const std::int32_t half = blue + (orange >> 1);
  const std::int32_t green = kLevelOfByte[c.g] - half;
  return Int4{half + (green >> 1), orange, green, 0};
}

// Four colours from four codes, red in the lowest byte. Unsigned sums: hostile codes may wrap.
LUMIGRID_INLINE Uint4 codeColors(Uint4 luma, Uint4 orange, Uint4 green, Uint4 alpha) {
  const auto half_of = [](Uint4 x) { return reinterpret_cast<Uint4>(reinterpret_cast<Int4>(x) >> 1); };
  const Uint4 half = luma - half_of(green);
  const Uint4 blue = half - half_of(orange);
  const auto bytes = [](Uint4 level) { return reinterpret_cast<Uint4>(levelBytes(reinterpret_cast<Int4>(level))); };
  return bytes(blue + orange) | bytes(green + half) << 8 | bytes(blue) << 16 | alpha << 24;
}

// Planes of numbers -------------------------------------------------------------------------------
//
// Rice codes with a width per 16 numbers: the low bits of all of them, whole bytes; the rest in unary, in a stream of
// its own, so that both are read without waiting for each other. Widths in nibbles; 15: 32 low bits and no unary. Where
// all are near each other, in two bits, above the least of them.
constexpr std::size_t kGroup = 16;
constexpr std::uint32_t kRawWidth = 15;
// Unary bits of a group: fewer than one unaligned load of eight bytes yields.
constexpr std::uint32_t kMaxUnary = 56;
// The highest bit of a plane's count of unary bytes, which is below: widths in two bits follow, after the least width.
constexpr std::uint32_t kNarrowWidths = 0x8000;
constexpr std::uint32_t kNarrowSpan = 4;
static_assert((kMaxPatchVertices + kGroup) / kGroup * kMaxUnary / 8 < kNarrowWidths);

constexpr std::size_t groupsOf(std::size_t count) {
  return (count + kGroup - 1) / kGroup;
}

constexpr std::size_t lowBytes(std::uint32_t width) {
  return width == kRawWidth ? 64 : 2 * std::size_t{width};
}

// Of sixteen groups, their widths in nibbles.
constexpr std::size_t lowBytesOfSixteen(std::uint64_t widths) {
  constexpr std::uint64_t kNibbles = 0x0F0F0F0F0F0F0F0F, kSum = 0x0101010101010101;
  const std::uint64_t pairs = (widths & kNibbles) + (widths >> 4 & kNibbles);
  const std::uint64_t raw = widths & widths >> 1 & widths >> 2 & widths >> 3 & 0x1111111111111111;
  const std::uint64_t raw_pairs = (raw & kNibbles) + (raw >> 4 & kNibbles);
  return 2 * (pairs * kSum >> 56) + (64 - 2 * kRawWidth) * (raw_pairs * kSum >> 56);
}
static_assert(lowBytesOfSixteen(0xFFFFFFFFFFFFFFFF) == 16 * lowBytes(kRawWidth));
static_assert(lowBytesOfSixteen(0xF000000000000EF1) == 2 * lowBytes(kRawWidth) + lowBytes(14) + lowBytes(1));

std::uint32_t zigzag(std::int32_t x) {
  return (static_cast<std::uint32_t>(x) << 1) ^ static_cast<std::uint32_t>(x >> 31);
}

Uint4 zigzag(Uint4 x) {
  return x << 1 ^ reinterpret_cast<Uint4>(reinterpret_cast<Int4>(x) >> 31);
}

std::uint32_t unzigzag(std::uint32_t x) {
  return (x >> 1) ^ (0U - (x & 1U));
}

std::uint32_t sumOfLanes(Uint4 x) {
  x += __builtin_shufflevector(x, x, 2, 3, 0, 1);
  return x[0] + x[1];
}

// Sixteen numbers to be written.
class Numbers {
 public:
  explicit Numbers(const std::uint32_t* values) { std::memcpy(four_, values, sizeof(four_)); }

  // The width that takes fewest bits, of those about the logarithm of the mean and from `least` on.
  std::uint32_t bestWidth(std::uint32_t least_width = 0) const {
    // Halves, whose sums overflow nowhere.
    const Uint4 low = (four_[0] & 0xFFFFU) + (four_[1] & 0xFFFFU) + (four_[2] & 0xFFFFU) + (four_[3] & 0xFFFFU);
    const Uint4 high = (four_[0] >> 16) + (four_[1] >> 16) + (four_[2] >> 16) + (four_[3] >> 16);
    const std::uint64_t sum = sumOfLanes(low) + (std::uint64_t{sumOfLanes(high)} << 16);
    std::uint32_t width = static_cast<std::uint32_t>(std::bit_width(sum / kGroup));
    width = std::max(width > 2 ? width - 2 : 0, least_width);
    std::uint32_t best = kRawWidth;
    std::uint32_t least = 512;
    for (; width < kRawWidth; ++width) {
      // No value is above sixteen times the mean, so from this width on their sums are small.
      const std::uint32_t bits = bitsAt(width);
      if (bits == kImpossible) continue;
      if (bits >= least) break;  // more low bits only cost more from here on
      least = bits;
      best = width;
    }
    return best;
  }

  // Bits that they take with that width; kImpossible if the unary ones are too many.
  static constexpr std::uint32_t kImpossible = 1U << 20;
  std::uint32_t bitsAt(std::uint32_t width) const {
    if (width == kRawWidth) return 512;
    const Uint4 above = (four_[0] >> width) + (four_[1] >> width) + (four_[2] >> width) + (four_[3] >> width);
    const std::uint32_t unary = kGroup + sumOfLanes(above);
    return unary > kMaxUnary ? kImpossible : unary + static_cast<std::uint32_t>(kGroup) * width;
  }

 private:
  Uint4 four_[kGroup / 4];
};

std::uint64_t load64(const std::uint8_t* at) {
  std::uint64_t word = 0;
  std::memcpy(&word, at, sizeof(word));
  return word;
}

std::uint32_t load32(const std::uint8_t* at) {
  std::uint32_t word = 0;
  std::memcpy(&word, at, sizeof(word));
  return word;
}

void store64(std::uint8_t* at, std::uint64_t word) {
  std::memcpy(at, &word, sizeof(word));
}

// The low bits of a group, side by side: 2 · width bytes. Eight bytes behind them are overwritten.
void storeLows(const std::uint32_t* group, std::uint32_t width, std::uint8_t* to) {
  const std::uint64_t mask = (std::uint64_t{1} << width) - 1;
  const auto four = [&](const std::uint32_t* v) {
    return (v[0] & mask) | (v[1] & mask) << width | (v[2] & mask) << (2 * width) | (v[3] & mask) << (3 * width);
  };
  // Four take a whole number of bytes, or half a byte more: that half goes before the next four.
  const std::uint32_t whole = width / 2;
  const std::uint32_t odd = 4 * (width % 2);
  for (std::size_t i = 0; i < kGroup; i += 8, to += width) {
    const std::uint64_t first = four(group + i);
    store64(to, first);
    store64(to + whole, (odd != 0 ? first >> (8 * whole) : 0) | four(group + i + 4) << odd);
  }
}

// What writing planes needs beyond its result, for planes of up to `count` numbers, whole groups.
class PlaneWriter {
 public:
  explicit PlaneWriter(std::size_t count)
      : widths_(count / kGroup), low_(count / kGroup * lowBytes(kRawWidth) + 8), unary_(count / 2 + 16) {}

  void write(base::ByteWriter& out, std::span<const std::uint32_t> values) {
    const std::size_t groups = values.size() / kGroup;
    const std::uint32_t least = chooseWidths(values, groups);
    std::uint8_t* low = low_.data();
    std::size_t bit = 0;
    unary_[0] = 0;
    for (std::size_t g = 0; g < groups; ++g) {
      const std::uint32_t* group = values.data() + g * kGroup;
      const std::uint32_t width = widths_[g];
      if (width == kRawWidth) {
        std::memcpy(low, group, lowBytes(width));
      } else {
        storeLows(group, width, low);
        storeOnes(group, width, bit);
      }
      low += lowBytes(width);
    }
    const std::size_t unary_bytes = (bit + 7) / 8;
    const bool is_narrow = least != kRawWidth;
    out.u16(static_cast<std::uint16_t>(unary_bytes | (is_narrow ? kNarrowWidths : 0)));
    if (is_narrow) out.u8(static_cast<std::uint8_t>(least));
    const std::size_t per_byte = is_narrow ? 4 : 2;
    for (std::size_t g = 0; g < groups; g += per_byte) {
      std::uint32_t byte = 0;
      for (std::size_t k = 0; k < per_byte && g + k < groups; ++k)
        byte |= (widths_[g + k] - (is_narrow ? least : 0)) << (8 / per_byte * k);
      out.u8(static_cast<std::uint8_t>(byte));
    }
    out.bytes(base::ByteView(low_.data(), low));
    out.bytes(base::ByteView(unary_).first(unary_bytes));
  }

 private:
  // What lies above the low bits, in unary, from `bit` on, which moves behind it.
  void storeOnes(const std::uint32_t* group, std::uint32_t width, std::size_t& bit) {
    std::uint64_t ones = 0;
    std::uint32_t place = 0;
    for (std::size_t i = 0; i < kGroup; ++i) {
      place += group[i] >> width;
      ones |= std::uint64_t{1} << place++;
    }
    std::uint8_t* to = unary_.data() + bit / 8;
    store64(to, *to | ones << (bit % 8));
    bit += place;
  }

  // Of each group, into widths_. Returns the least where all are within kNarrowSpan, which saves half of their room and
  // costs a group outside little; else kRawWidth.
  std::uint32_t chooseWidths(std::span<const std::uint32_t> values, std::size_t groups) {
    std::array<std::uint32_t, kRawWidth + 1> count{};
    for (std::size_t g = 0; g < groups; ++g) {
      widths_[g] = static_cast<std::uint8_t>(Numbers(&values[g * kGroup]).bestWidth());
      ++count[widths_[g]];
    }
    // Where most are.
    std::uint32_t least = 0;
    std::uint32_t most = 0;
    for (std::uint32_t w = 0; w + kNarrowSpan <= kRawWidth; ++w) {
      const std::uint32_t inside = count[w] + count[w + 1] + count[w + 2] + count[w + 3];
      if (inside > most) most = inside, least = w;
    }

    std::size_t saved = (groups + 1) / 2 - (groups + 3) / 4;
    saved = saved > 0 ? 8 * (saved - 1) : 0;
    const auto inSpan = [&](std::uint32_t w) { return std::clamp(w, least, least + kNarrowSpan - 1); };
    std::size_t lost = 0;
    for (std::size_t g = 0; g < groups && lost <= saved; ++g) {
      if (inSpan(widths_[g]) == widths_[g]) continue;
      const Numbers numbers(&values[g * kGroup]);
      const std::uint32_t bits = numbers.bitsAt(inSpan(widths_[g]));
      if (bits == Numbers::kImpossible) return kRawWidth;
      lost += bits - std::min(bits, numbers.bitsAt(widths_[g]));
    }
    if (lost >= saved) return kRawWidth;
    for (std::size_t g = 0; g < groups; ++g) widths_[g] = static_cast<std::uint8_t>(inSpan(widths_[g]));
    return least;
  }

  std::vector<std::uint8_t> widths_;
  base::Bytes low_;
  base::Bytes unary_;
};

// Where the parts of a plane are.
struct PlaneParts {
  const std::uint8_t* widths = nullptr;
  const std::uint8_t* low = nullptr;
  const std::uint8_t* unary = nullptr;
  std::size_t unary_bytes = 0;

  std::uint32_t width(std::size_t group) const { return widths[group / 2] >> (4 * (group % 2)) & 15U; }
};

// Two bits each to nibbles, each `least` more.
LUMIGRID_INLINE std::uint64_t widened(std::uint32_t pairs, std::uint32_t least) {
  std::uint64_t x = pairs;
  x = (x | x << 16) & 0x0000FFFF0000FFFF;
  x = (x | x << 8) & 0x00FF00FF00FF00FF;
  x = (x | x << 4) & 0x0F0F0F0F0F0F0F0F;
  x = (x | x << 2) & 0x3333333333333333;
  return x + 0x1111111111111111U * least;
}

// The plane at `at`, which moves behind it. False when it runs past the end; `in` may be read eight bytes past it.
// `widths` has room for a nibble a group and 16 bytes more.
LUMIGRID_INLINE bool findPlane(base::ByteView in, std::size_t& at, std::size_t groups, std::uint8_t* widths,
                               PlaneParts& plane) {
  if (in.size() - at < 3) return false;
  const std::uint32_t first = in[at] | std::uint32_t{in[at + 1]} << 8;
  const bool is_narrow = (first & kNarrowWidths) != 0;
  const std::size_t unary_bytes = first & (kNarrowWidths - 1);
  const std::uint32_t least = in[at + 2];
  if (is_narrow && least + kNarrowSpan > kRawWidth) return false;
  at += is_narrow ? 3 : 2;
  const std::size_t width_bytes = is_narrow ? (groups + 3) / 4 : (groups + 1) / 2;
  if (in.size() - at < width_bytes) return false;
  plane.widths = widths;
  std::size_t low_bytes = 0;
  for (std::size_t g = 0; g < groups; g += 16) {
    const std::uint64_t unused = groups - g < 16 ? ~std::uint64_t{0} << (4 * (groups - g)) : 0;
    const std::uint64_t sixteen =
        is_narrow ? widened(load32(in.data() + at + g / 4), least) : load64(in.data() + at + g / 2);
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

void readRaw(const std::uint8_t* low, std::uint32_t* out) {
  std::memcpy(out, low, 4 * kGroup);
  for (std::size_t i = 0; i < kGroup; ++i) out[i] = unzigzag(out[i]);
}

// Reads the differences of one plane, whole groups. False when the plane runs past the end, a group has too many unary
// bits or the plane has other unary bytes than its groups fill. `in` may be read eight bytes past its end; `room` is
// for the widths and a byte per number.
struct PlaneRoom {
  std::uint8_t* widths = nullptr;  // a nibble per group and 16 bytes more
  std::uint8_t* places = nullptr;  // a byte per number and 80 more
};
using PlaneReader = bool (*)(base::ByteView in, std::size_t& at, std::size_t groups, const PlaneRoom& room,
                             std::uint32_t* out);

bool readPlaneAnywhere(base::ByteView in, std::size_t& at, std::size_t groups, const PlaneRoom& room,
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
        // The next one ends the number.
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
// Places of the ones in each byte, lowest first.
constexpr auto kOnes = [] {
  std::array<std::array<std::uint8_t, 8>, 256> places{};
  for (std::size_t byte = 0; byte < 256; ++byte)
    for (std::size_t bit = 0, i = 0; bit < 8; ++bit)
      if ((byte >> bit & 1U) != 0) places[byte][i++] = static_cast<std::uint8_t>(bit);
  return places;
}();

// Places of the ones in a plane's unary bits, modulo 256, behind places[0]; their count. No more than `most` and a few.
__attribute__((LUMIGRID_AVX2)) std::size_t findOnesByAvx2(const PlaneParts& plane, std::size_t most,
                                                          std::uint8_t* places) {
  std::size_t ones = 0;
  __m128i first_bit = _mm_setzero_si128();
  for (std::size_t i = 0; i < plane.unary_bytes && ones < most; i += 8) {
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

// The same, 64 bits at a time.
constexpr auto kEveryPlace = [] {
  std::array<std::uint8_t, 64> places{};
  for (std::size_t bit = 0; bit < 64; ++bit) places[bit] = static_cast<std::uint8_t>(bit);
  return places;
}();
__attribute__((target("avx512f,avx512bw,avx512vbmi2,popcnt"))) std::size_t findOnesByAvx512(const PlaneParts& plane,
                                                                                            std::size_t most,
                                                                                            std::uint8_t* places) {
  std::size_t ones = 0;
  __m512i every = _mm512_loadu_si512(kEveryPlace.data());
  for (std::size_t i = 0; i < plane.unary_bytes && ones < most; i += 8) {
    const std::uint64_t word = load64(plane.unary + i);
    _mm512_storeu_si512(places + 1 + ones, _mm512_maskz_compress_epi8(word, every));
    ones += static_cast<std::size_t>(_mm_popcnt_u64(word));
    every = _mm512_add_epi8(every, _mm512_set1_epi8(64));
  }
  return ones;
}

// The same by vectors, a group at once, when the places of all ones are known. They are modulo 256; a group that looks
// short and is not is missed in the sum of lengths.
using OnesFinder = std::size_t (*)(const PlaneParts& plane, std::size_t most, std::uint8_t* places);
template <OnesFinder kFindOnes>
__attribute__((LUMIGRID_AVX2)) bool readPlaneByAvx2(base::ByteView in, std::size_t& at, std::size_t groups,
                                                    const PlaneRoom& room, std::uint32_t* out) {
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
    // Zeros between a one and the one before it.
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

// Connectivity ------------------------------------------------------------------------------------
//
// The cut-border machine of Gumhold and Strasser 1998 with its front in a ring. The front holds directed edges that
// a triangle may still use; one more is the gate. A step either attaches a triangle to the gate or gives the gate up.
// Nothing about the surface has to hold: what the front does not foresee is an escape.

// A directed edge that a further triangle may have, and the third corner of the triangle on its other side.
struct Edge {
  std::uint16_t a = 0;
  std::uint16_t b = 0;
  std::uint16_t opposite = 0;
};

constexpr std::uint64_t packEdge(std::uint64_t a, std::uint64_t b, std::uint64_t opposite) {
  return a | b << 16 | opposite << 32;
}

// Steps, two bits each.
constexpr std::uint32_t kNewVertex = 0;  // the gate's triangle has the next new vertex
constexpr std::uint32_t kNext = 1;       // … the end of the front's first edge
constexpr std::uint32_t kGiveUp = 2;     // no triangle: the front's first edge becomes the gate
constexpr std::uint32_t kEscape = 3;     // a byte of the escapes says

// What an escape does, from the byte kFirstKind on; bytes below: a vertex that many before the newest. Known vertices
// are u16 from the escapes' end backwards.
constexpr std::uint32_t kFirstKind = 247;
constexpr std::uint32_t kPrevious = 0;    // the start of the front's last edge
constexpr std::uint32_t kCloseLast = 1;   // no triangle: drop the front's last edge too, then as kGiveUp
constexpr std::uint32_t kCloseFirst = 2;  // … the front's first edge
constexpr std::uint32_t kFold = 3;        // a triangle on the front's first two edges, not on the gate
constexpr std::uint32_t kKnown = 4;       // any known vertex
constexpr std::uint32_t kStart = 5;       // an edge from nowhere; + 1, 2: its first, second corner is a known one

// The same before version 4, where known vertices followed at once and a start was a whole triangle.
constexpr std::uint32_t kOldFirstKind = 240;
constexpr std::uint32_t kOldStart = 0;  // + 1, 2, 4: first, second, third corner is a known one
constexpr std::uint32_t kOldPrevious = 8;

// What a new vertex is predicted from: a + b − opposite.
struct Connectivity {
  std::vector<std::uint32_t> vertices;   // old numbers in the new order
  std::vector<std::uint32_t> triangles;  // old numbers in the new order
  std::vector<std::uint16_t> indices;
  std::vector<Edge> from;  // new numbers
  std::uint32_t steps = 0;
  base::Bytes step_bytes;
  base::Bytes escapes;
  std::uint8_t front_bits = 0;
};

// Two bits each, from the lowest up.
class StepWriter {
 public:
  void put(std::uint32_t step) {
    current_ |= step << (2 * (count_++ % 4));
    if (count_ % 4 != 0) return;
    bytes_.push_back(static_cast<std::uint8_t>(current_));
    current_ = 0;
  }
  std::uint32_t count() const { return count_; }
  base::Bytes take() {
    if (count_ % 4 != 0) bytes_.push_back(static_cast<std::uint8_t>(current_));
    return std::move(bytes_);
  }

 private:
  base::Bytes bytes_;
  std::uint32_t current_ = 0;
  std::uint32_t count_ = 0;
};

// A triangle at a vertex, and its last corner seen from there.
struct TriangleUse {
  std::uint16_t triangle = 0;
  std::uint16_t third = 0;
};

// The triangle to attach, and how little that costs.
constexpr int kNoTriangle = -1;
constexpr int kSeveralTriangles = -2;
struct FoundTriangle {
  TriangleUse use;
  int rank = kNoTriangle;
};

// Finds the triangle behind an edge at once where no edge is used twice in the same direction, as on all surfaces worth
// the name. Elsewhere it stops, and a careful walk looks at the triangles one by one.
class Walk {
 public:
  Walk(const PatchGeometry& geometry, bool careful)
      : geometry_(geometry),
        triangles_(static_cast<std::uint32_t>(geometry.indices.size() / 3)),
        careful_(careful),
        first_(geometry.positions.size() + 2, 0),
        uses_(geometry.indices.size()),
        next_(geometry.indices.size() + kLanes, 0),
        done_(triangles_, 0),
        number_(geometry.positions.size(), kUnnumbered),
        front_(2 * std::size_t{triangles_} + 1) {
    // Each vertex's first comes to stand one place behind, and moves to the next one's as uses are added.
    for (const std::uint16_t v : geometry.indices) ++first_[std::size_t{v} + 2];
    for (std::size_t v = 2; v < first_.size(); ++v) {
      // A fan of more is not looked at to its end.
      careful_ = careful_ || first_[v] > kMaxLooked;
      first_[v] += first_[v - 1];
    }
    for (std::uint32_t t = 0; t < triangles_; ++t) {
      const std::uint16_t* c = &geometry.indices[3 * std::size_t{t}];
      addUse(c[0], c[1], {static_cast<std::uint16_t>(t), c[2]});
      addUse(c[1], c[2], {static_cast<std::uint16_t>(t), c[0]});
      addUse(c[2], c[0], {static_cast<std::uint16_t>(t), c[1]});
    }
    if (careful_) {
      left_.resize(geometry.positions.size());
      for (std::size_t v = 0; v < left_.size(); ++v) left_[v] = first_[v + 1] - first_[v];
    }
    out_.indices.resize(geometry.indices.size());
    out_.triangles.resize(triangles_);
    out_.vertices.resize(geometry.positions.size() + 1);
    out_.from.resize(geometry.positions.size() + 1);
  }

  // False when it takes a careful walk.
  bool run() {
    std::uint32_t next = 0;
    while (used_ < triangles_) {
      if (open_) {
        if (!advance()) return false;
        continue;
      }
      while (done_[next] != 0) ++next;
      start(next);
    }
    return true;
  }
  Connectivity take() {
    out_.vertices.resize(numbered_);
    out_.from.resize(numbered_);
    out_.steps = steps_.count();
    out_.step_bytes = steps_.take();
    for (std::size_t i = known_.size(); i-- > 0;) {
      out_.escapes.push_back(static_cast<std::uint8_t>(known_[i] & 255U));
      out_.escapes.push_back(static_cast<std::uint8_t>(known_[i] >> 8));
    }
    out_.front_bits = static_cast<std::uint8_t>(std::bit_width(longest_ + 1));
    LUMIGRID_CHECK_LE(out_.front_bits, kMaxFrontBits);
    return std::move(out_);
  }

 private:
  static constexpr std::uint32_t kUnnumbered = ~0U;
  // Most unused triangles looked at around one vertex; more than any scan has, and a fan of thousands stays cheap.
  static constexpr std::uint32_t kMaxLooked = 64;
  static constexpr std::uint32_t kLanes = 8;
  using Short8 = std::uint16_t __attribute__((vector_size(16)));
  using Byte8 = std::int8_t __attribute__((vector_size(8)));

  void addUse(std::uint16_t v, std::uint16_t next, const TriangleUse& use) {
    const std::uint32_t at = first_[std::size_t{v} + 1]++;
    uses_[at] = use;
    next_[at] = next;
  }
  bool empty() const { return head_ == tail_; }
  void escape(std::uint32_t kind) {
    steps_.put(kEscape);
    out_.escapes.push_back(static_cast<std::uint8_t>(kFirstKind + kind));
  }
  void push(const Edge& e) {
    front_[tail_++] = e;
    longest_ = std::max(longest_, tail_ - head_);
  }
  void takeFirst() {
    open_ = !empty();
    if (open_) gate_ = front_[head_++];
  }
  std::uint16_t numberOf(std::uint16_t v) const { return static_cast<std::uint16_t>(number_[v]); }
  void addVertex(std::uint16_t v, const Edge& from) {
    number_[v] = numbered_;
    out_.vertices[numbered_] = v;
    out_.from[numbered_++] = from;
  }
  void addTriangle(std::uint32_t t, std::uint16_t a, std::uint16_t b, std::uint16_t c) {
    done_[t] = 1;
    std::uint16_t* corner = &out_.indices[3 * std::size_t{used_}];
    corner[0] = numberOf(a), corner[1] = numberOf(b), corner[2] = numberOf(c);
    out_.triangles[used_++] = t;
  }
  bool isKnown(std::uint16_t v) const { return number_[v] != kUnnumbered; }

  // Corners that are known come first: an edge, then the triangle on it.
  void start(std::uint32_t t) {
    std::array<std::uint16_t, 3> c{};
    std::memcpy(c.data(), &geometry_.indices[3 * std::size_t{t}], sizeof(c));
    const auto later = [&](std::size_t a, std::size_t b) { return !isKnown(c[a]) && isKnown(c[b]); };
    while (later(0, 1) || later(1, 2)) std::rotate(c.begin(), c.begin() + 1, c.end());

    const std::size_t at = out_.escapes.size();
    escape(kStart);
    std::uint16_t before = numbered_ == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(numbered_ - 1);
    for (std::size_t k = 0; k < 2; ++k) {
      if (isKnown(c[k])) {
        out_.escapes[at] = static_cast<std::uint8_t>(out_.escapes[at] + (1U << k));
        known_.push_back(numberOf(c[k]));
      } else {
        addVertex(c[k], {before, before, before});
      }
      before = numberOf(c[k]);
    }
    push({c[1], c[0], isKnown(c[2]) ? c[0] : c[2]});
    gate_ = {c[0], c[1], c[0]};
    if (isKnown(c[2]))
      attachOther({{static_cast<std::uint16_t>(t), c[2]}, 0});
    else
      attachNewOrNext({static_cast<std::uint16_t>(t), c[2]}, true);
    open_ = true;
  }

  // What attaching a triangle with that third corner costs: the higher, the less.
  int rankOf(std::uint16_t third) const {
    int rank = number_[third] == kUnnumbered ? 1 : 0;
    if (!empty() && third == front_[tail_ - 1].a) rank = 2;
    if (!empty() && third == front_[head_].b) rank = 3;
    return rank;
  }

  // The unused triangle with that edge; kSeveralTriangles where triangles share it, used or not.
  FoundTriangle findOnly(const Edge& edge) const {
    const std::uint32_t begin = first_[edge.a];
    const std::uint32_t end = first_[std::size_t{edge.a} + 1];
    std::uint32_t place = end;
    for (std::uint32_t i = begin; i < end; i += kLanes) {
      Short8 next;
      std::memcpy(&next, &next_[i], sizeof(next));
      auto same = base::bitCast<std::uint64_t>(__builtin_convertvector(next == edge.b, Byte8));
      if (end - i < kLanes) same &= (std::uint64_t{1} << (8 * (end - i))) - 1;
      if (same == 0) continue;
      const auto lane = static_cast<std::uint32_t>(std::countr_zero(same)) / 8;
      if (place != end || (same & ~(std::uint64_t{255} << (8 * lane))) != 0) return {{}, kSeveralTriangles};
      place = i + lane;
    }
    if (place == end || done_[uses_[place].triangle] != 0) return {};
    return {uses_[place], rankOf(uses_[place].third)};
  }

  // Of the unused triangles with the gate's edge, the one that costs least.
  FoundTriangle findBest() {
    FoundTriangle best;
    TriangleUse* uses = uses_.data() + first_[gate_.a];
    std::uint16_t* next = next_.data() + first_[gate_.a];
    std::uint32_t& left = left_[gate_.a];
    std::uint32_t looked = 0;
    for (std::uint32_t i = 0; i < left && looked < kMaxLooked;) {
      if (done_[uses[i].triangle] != 0) {
        --left;
        uses[i] = uses[left];
        next[i] = next[left];
        continue;
      }
      const TriangleUse& use = uses[i];
      ++looked;
      if (next[i++] != gate_.b) continue;
      if (const int rank = rankOf(use.third); rank > best.rank) best = {use, rank};
    }
    return best;
  }

  bool advance() {
    FoundTriangle found = careful_ ? findBest() : findOnly(gate_);
    if (found.rank == kSeveralTriangles) return false;
    if (found.rank == 0 && !careful_ && foldTo(found.use.third)) found.rank = 3;
    if (found.rank == kNoTriangle)
      giveUp();
    else if (found.rank == 1 || found.rank == 3)
      attachNewOrNext(found.use, found.rank == 1);
    else
      attachOther(found);
    return true;
  }

  // Where the third corner is a little ahead on the front and triangles of the gate's end fill what lies between, they
  // are folded away: the front's first edge ends there then. A split and all that closes it again would cost more.
  bool foldTo(std::uint16_t third) {
    constexpr std::size_t kMaxFolds = 3;
    std::array<FoundTriangle, kMaxFolds> between;
    std::size_t folds = 0;
    for (std::uint16_t end = gate_.b; folds <= kMaxFolds && head_ + folds < tail_; ++folds) {
      const Edge& edge = front_[head_ + folds];
      if (edge.a != end) return false;
      end = edge.b;
      if (folds > 0) {
        FoundTriangle& found = between[folds - 1];
        found = findOnly(edge);
        // An edge at the gate's end would make it a triangle counted twice.
        const bool touches = edge.a == gate_.b || edge.b == gate_.b;
        if (touches || found.rank < 0 || found.use.third != gate_.b) return false;
      }
      if (end != third) continue;
      for (std::size_t i = 0; i < folds; ++i) {
        escape(kFold);
        const Edge& folded = front_[++head_];
        addTriangle(between[i].use.triangle, gate_.b, folded.a, folded.b);
      }
      return true;
    }
    return false;
  }

  void giveUp() {
    const auto closes = [&](const Edge& e) { return e.a == gate_.b && e.b == gate_.a; };
    if (!empty() && closes(front_[tail_ - 1])) {
      escape(kCloseLast);
      --tail_;
    } else if (!empty() && closes(front_[head_])) {
      escape(kCloseFirst);
      ++head_;
    } else {
      steps_.put(kGiveUp);
    }
    takeFirst();
  }

  // Which of the two it is cannot be foreseen: both are done, and one counts.
  void attachNewOrNext(const TriangleUse& use, bool is_new) {
    const Edge gate = gate_;
    const std::uint16_t third = use.third;
    steps_.put(is_new ? kNewVertex : kNext);
    out_.vertices[numbered_] = third;
    out_.from[numbered_] = {numberOf(gate.a), numberOf(gate.b), numberOf(gate.opposite)};
    number_[third] = is_new ? numbered_ : number_[third];
    front_[tail_] = {gate.a, third, gate.b};
    gate_ = {is_new ? third : gate.a, is_new ? gate.b : third, is_new ? gate.a : gate.b};
    numbered_ += is_new ? 1 : 0;
    tail_ += is_new ? 1 : 0;
    head_ += is_new ? 0 : 1;
    longest_ = std::max(longest_, tail_ - head_);
    addTriangle(use.triangle, gate.a, gate.b, third);
  }

  void attachOther(const FoundTriangle& found) {
    const Edge gate = gate_;
    const std::uint16_t third = found.use.third;
    if (found.rank == 2) {
      escape(kPrevious);
      --tail_;
    } else {
      if (const std::uint32_t back = numbered_ - 1 - number_[third]; back < kFirstKind) {
        steps_.put(kEscape);
        out_.escapes.push_back(static_cast<std::uint8_t>(back));
      } else {
        escape(kKnown);
        known_.push_back(numberOf(third));
      }
      push({gate.a, third, gate.b});
    }
    gate_ = {third, gate.b, gate.a};
    addTriangle(found.use.triangle, gate.a, gate.b, third);
  }

  const PatchGeometry& geometry_;
  std::uint32_t triangles_;
  bool careful_;
  // Triangles by vertex, from first_ on. A careful walk drops used ones when it meets them: left_ are left.
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> left_;
  std::vector<TriangleUse> uses_;
  std::vector<std::uint16_t> next_;  // as many, and room to read over the end
  std::vector<std::uint8_t> done_;
  std::vector<std::uint32_t> number_;
  std::vector<Edge> front_;  // from head_ to tail_; old numbers
  std::size_t head_ = 0;
  std::size_t tail_ = 0;
  std::size_t longest_ = 0;
  Edge gate_;
  bool open_ = false;
  std::uint32_t numbered_ = 0;  // vertices
  std::uint32_t used_ = 0;      // triangles
  StepWriter steps_;
  std::vector<std::uint16_t> known_;
  Connectivity out_;
};

Connectivity walk(const PatchGeometry& geometry) {
  for (const bool careful : {false, true})
    if (Walk walk(geometry, careful); walk.run()) return walk.take();
  return {};
}

// Steps decoded between two looks at the counts, hence the room that arrays need behind their ends.
constexpr std::size_t kStepsAtOnce = 32;
constexpr std::size_t kSlack = 4 + kStepsAtOnce;

// What decoding needs beyond its result. Kept by thread: patches come by the thousand.
struct Scratch {
  base::Bytes bytes;
  std::vector<std::uint8_t> widths;
  std::vector<std::uint8_t> places;  // of ones in unary bits
  std::vector<std::uint64_t> front;
  std::vector<std::uint64_t> from;  // packed edges by vertex
  std::vector<Uint4> positions;
  std::vector<Uint4> colors;
  std::array<std::vector<std::uint32_t>, 3> planes;
  std::vector<std::uint32_t> normal_u;
  std::vector<std::uint32_t> normal_v;
  std::vector<std::uint32_t> alphas;
  std::vector<Corner> corners;
  // The result, with room for whole vectors behind it. Copied when it is done: that takes less time than clearing it.
  std::vector<std::uint16_t> indices;
  std::vector<glm::ivec3> lattice;
  std::vector<glm::vec3> normals;
  std::vector<glm::u8vec4> rgba;

  template <class T>
  static T* room(std::vector<T>& v, std::size_t count) {
    if (v.size() < count) v.resize(count);
    return v.data();
  }
  PlaneRoom planeRoom(std::size_t groups) {
    return {room(widths, groups / 2 + 16), room(places, groups * kGroup + 80)};
  }
};

// What a step does, as masks and counts.
struct Choice {
  std::uint64_t is_new, is_next, is_none;
  std::uint32_t pushed, taken, corners, unused;
};
constexpr std::array<Choice, 3> kChoices{
    {{~0ULL, 0, 0, 1, 0, 3, 0}, {0, ~0ULL, 0, 0, 1, 3, 0}, {0, 0, ~0ULL, 0, 1, 0, 0}}};

#if defined(__x86_64__)
// Steps and escapes by vectors: 32 are told apart at once, and where each reads and writes follows from sums over
// those before it, whatever their edges are. Then each is a shuffle of eight words: gate's a, b, opposite, nothing,
// then a, b, opposite of the edge it reads, a vertex. No branch has to be foreseen but for known vertices and starts.
enum : std::uint8_t { kTake, kAttach, kAttachFirst, kAttachLast, kFold2, kStartEdge, kPatternCount };
constexpr std::size_t kPatternBytes = 64;
constexpr std::size_t kCornerBytes = 6;
// 48 bits of a register; what is above them is zero.
using Shuffle = std::array<std::uint8_t, 16>;
constexpr Shuffle threeWords(std::uint8_t a, std::uint8_t b, std::uint8_t c) {
  Shuffle bytes{};
  const std::array<std::uint8_t, 3> words{a, b, c};
  for (std::size_t k = 0; k < bytes.size(); ++k)
    bytes[k] = k < kCornerBytes ? static_cast<std::uint8_t>(2 * words[k / 2] + k % 2) : std::uint8_t{0x80};
  return bytes;
}
// Which words make up its triangle, and which ones the next gate. A pattern with a triangle lies that many bytes off
// its multiple of kPatternBytes that the triangle takes.
alignas(64) constexpr auto kPatterns = [] {
  struct Words {
    Shuffle triangle, gate;
    bool has_triangle;
  };
  const std::array<Words, kPatternCount> all{{{threeWords(0, 1, 5), threeWords(4, 5, 6), false},
                                              {threeWords(0, 1, 7), threeWords(7, 1, 0), true},
                                              {threeWords(0, 1, 5), threeWords(0, 5, 1), true},
                                              {threeWords(0, 1, 4), threeWords(4, 1, 0), true},
                                              {threeWords(1, 4, 5), threeWords(0, 1, 2), true},
                                              {threeWords(5, 6, 4), threeWords(4, 5, 4), false}}};
  std::array<std::uint8_t, kPatternCount * kPatternBytes> bytes{};
  for (std::size_t p = 0; p < all.size(); ++p)
    for (std::size_t k = 0; k < 16; ++k) {
      const std::size_t at = kPatternBytes * p + (all[p].has_triangle ? kCornerBytes : 0);
      bytes[at + k] = all[p].triangle[k];
      bytes[at + 16 + k] = all[p].gate[k];
    }
  return bytes;
}();
// What a corner triple (a, b, third) pushes: (a, third, b).
alignas(16) constexpr Shuffle kPushedWords = threeWords(0, 2, 1);

// By step, 0 to 2; a vertex before the newest, 3; kinds of escapes, from 4 on. Starts have their rows by known corners.
struct StepTables {
  using Row = std::array<std::int8_t, 16>;
  Row pattern{kAttach, kAttachFirst, kTake,      kAttach,    kAttachLast, kTake,     kTake,
              kFold2,  kAttach,      kStartEdge, kStartEdge, kStartEdge,  kStartEdge};
  Row corner_bytes{6, 6, 0, 6, 6, 0, 0, 6, 6};
  Row vertices{1, 0, 0, 0, 0, 0, 0, 0, 0, 2, 1, 1, 0};
  Row pushed{1, 0, 0, 1, -1, -1, 0, 0, 1, 1, 1, 1, 1};
  Row taken{0, 1, 1, 0, 0, 1, 2, 1, 0, -1, -1, -1, -1};
  Row second{0, 0, 0, 0, 0, 0, 1, 1};  // reads the front's second edge, not the first
  Row last{0, 0, 0, 0, -1};            // … or the last
};
alignas(16) constexpr StepTables kStepTables{};
constexpr std::uint32_t kFirstRow = 4;
constexpr std::uint8_t kNoStep = 0x80;  // zero in every table
#endif

class Machine {
 public:
  // Places that the front needs behind its ring, for starts.
  static constexpr std::size_t kBlocks = 4;
  static constexpr std::size_t kBehindRing = kBlocks * kStepsAtOnce;

  // `indices` has room for `triangles` and kSlack more, `from` for `vertices` and kSlack more.
  Machine(const PatchHeader& header, base::ByteView steps, base::ByteView escapes, std::uint64_t* front,
          std::uint16_t* indices, std::uint64_t* from)
      : header_(header),
        steps_(steps.data()),
        escape_(escapes.data()),
        escapes_end_(escapes.data() + escapes.size()),
        mask_((1U << header.front_bits) - 1),
        front_(front),
        indices_(indices),
        from_(from) {}

  // False when the counts are not met or the escapes run out. All numbers in indices and `from` are below the count of
  // vertices then: every one was new once. The upper 16 bits in `from` say nothing.
  bool run() {
    // Copies, which no store can change.
    std::uint64_t* const front = front_;
    std::uint64_t* const from = from_;
    std::uint16_t* const indices = indices_;
    const std::uint32_t mask = mask_;
    std::uint64_t gate = 0;
    // A start takes back what was taken from an empty front.
    std::uint32_t head = isOld() ? 0 : 1;
    std::uint32_t tail = 0;
    std::uint32_t vertices = 0;
    std::uint16_t* corner = indices;
    const std::uint32_t longest = isOld() ? ~0U : mask;
    const auto advance = [&](std::uint32_t i, std::uint32_t step) __attribute__((always_inline)) {
      if (step == kEscape) [[unlikely]] {
        step_ = i;
        state_ = {gate, head, tail, vertices, static_cast<std::uint32_t>((corner - indices) / 3)};
        const bool good = leave();
        gate = state_.gate, head = state_.head, tail = state_.tail;
        vertices = state_.vertices, corner = indices + 3 * std::size_t{state_.triangles};
        return good;
      }
      if (tail - head > longest) return false;
      // All three at once, and masks keep one: which it is cannot be foreseen.
      constexpr std::uint64_t kA = 0xFFFF, kB = kA << 16, kOpposite = kA << 32;
      const Choice& choice = kChoices[step];
      const std::uint64_t next = front[head & mask];
      const std::uint64_t end = next >> 16 & kA;
      const std::uint64_t third = end ^ ((end ^ vertices) & choice.is_new);
      const std::uint64_t corners = (gate & (kA | kB)) | third << 32;
      std::memcpy(corner, &corners, sizeof(corners));
      from[vertices] = gate;
      // (a, third, b) and (third, b, a): one stays or becomes the gate.
      const std::uint64_t left = (gate & kA) | (gate << 16 & kOpposite) | third << 16;
      const std::uint64_t right = third | (gate & kB) | gate << 32;
      front[tail & mask] = left;
      gate = (right & choice.is_new) | (left & choice.is_next) | (next & choice.is_none);
      tail += choice.pushed;
      vertices += choice.pushed;
      head += choice.taken;
      corner += choice.corners;
      return true;
    };

    const std::uint8_t* const steps = steps_;
    const std::uint32_t count = header_.steps;
    const std::uint32_t most_vertices = header_.vertices;
    const std::uint16_t* const last = indices + 3 * std::size_t{header_.triangles};
    for (std::uint32_t i = 0; i < count; ++i) {
      const bool good = advance(i, steps[i / 4] >> (2 * (i % 4)) & 3U);
      if (!good || vertices > most_vertices || corner > last) return false;
    }
    return vertices == most_vertices && corner == last && escape_ == escapes_end_ && tail - head <= longest;
  }

#if defined(__x86_64__)
  // The same.
  __attribute__((LUMIGRID_AVX2)) bool runByAvx2() {
    if (isOld() || header_.front_bits > kMaxBits) return run();
    const std::uint16_t* const last = indices_ + 3 * std::size_t{header_.triangles};
    __m128i gate = _mm_setzero_si128();
    std::uint16_t* corner = indices_;
    std::array<Block, kBlocks> blocks;
    state_ = {0, 1, 0, 0, 0};
    __m256i wrong = _mm256_setzero_si256();
    for (step_ = 0; step_ < header_.steps;) {
      std::size_t planned = 0;
      for (; planned < kBlocks && step_ < header_.steps; ++planned, step_ += kStepsAtOnce)
        if (!plan(blocks[planned], mask_ + 1 + static_cast<std::uint32_t>(kStepsAtOnce * planned), wrong)) return false;
      for (std::size_t b = 0; b < planned; ++b) {
        follow(blocks[b], gate, corner);
        if (corner > last) return false;
      }
    }
    return state_.vertices == header_.vertices && corner == last && escape_ == escapes_end_ &&
           state_.tail - state_.head <= mask_ && _mm256_testz_si256(wrong, wrong) != 0;
  }
#endif

 private:
  struct State {
    std::uint64_t gate = 0;
    std::uint32_t head = 0;
    std::uint32_t tail = 0;
    std::uint32_t vertices = 0;
    std::uint32_t triangles = 0;
  };

  bool isOld() const {
    return header_.version < 4;
  }
  std::uint32_t stepAt(std::uint32_t i) const {
    return steps_[i / 4] >> (2 * (i % 4)) & 3U;
  }

#if defined(__x86_64__)
  static constexpr std::uint8_t kMaxBits = 14;

  // What steps do, and where. Of each the new or known vertex of its triangle, and in one word, from the lowest 16 bits
  // up, its pattern's offset, where it reads the front, where it writes it, and where the gate goes that a new vertex
  // is foreseen from: memory is asked for eight things a step as it is.
  struct alignas(32) Block {
    std::array<std::uint16_t, kStepsAtOnce> third;
    std::array<std::uint64_t, kStepsAtOnce> step;
  };
  // Of sixteen steps that were interleaved within halves of registers.
  static constexpr std::size_t placeOf(std::size_t i) {
    return i / 16 * 16 + i % 8 / 2 * 4 + i / 8 % 2 * 2 + i % 2;
  }

#define LUMIGRID_HERE __attribute__((always_inline, LUMIGRID_AVX2))
  LUMIGRID_HERE static __m128i load(const void* at) {
    return _mm_loadu_si128(static_cast<const __m128i*>(at));
  }
  LUMIGRID_HERE static __m256i words(std::uint32_t x) {
    return _mm256_set1_epi16(static_cast<short>(x));
  }
  LUMIGRID_HERE static __m256i bytes(std::uint32_t x) {
    return _mm256_set1_epi8(static_cast<char>(x));
  }
  // Of each byte and all before it.
  LUMIGRID_HERE static __m256i sumsOf(__m256i x) {
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 1));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 2));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 4));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 8));
    return _mm256_add_epi8(x, _mm256_shuffle_epi8(_mm256_permute2x128_si256(x, x, 0x08), _mm256_set1_epi8(15)));
  }
  LUMIGRID_HERE static std::uint32_t lastOf(__m256i sums) {
    return static_cast<std::uint32_t>(static_cast<std::int8_t>(_mm256_extract_epi8(sums, 31)));
  }

  // The next steps' rows in kStepTables, and their escapes where the steps are. False when escapes run out.
  LUMIGRID_HERE bool tellApart(__m256i& row, __m256i& escape) {
    std::uint64_t steps = load64(steps_ + step_ / 4);
    const std::uint32_t left = header_.steps - step_;
    __m256i none = _mm256_setzero_si256();
    if (left < kStepsAtOnce) {
      steps = _bzhi_u64(steps, 2 * left);
      const __m256i places = _mm256_setr_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20,
                                              21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31);
      none = _mm256_and_si256(_mm256_cmpgt_epi8(places, bytes(left - 1)), bytes(kNoStep));
    }
    std::array<long long, 4> step_bytes{}, escape_bytes{};
#pragma GCC unroll 4
    for (std::size_t eight = 0; eight < 4; ++eight) {
      const std::uint64_t step = _pdep_u64(steps >> (16 * eight), 0x0303030303030303);
      const std::uint64_t is_escape = step & step >> 1 & 0x0101010101010101;
      step_bytes[eight] = static_cast<long long>(step);
      escape_bytes[eight] = static_cast<long long>(_pdep_u64(load64(escape_), is_escape * 255));
      escape_ += _mm_popcnt_u64(is_escape);
    }
    // Registers are put together: a load would wait for these stores, as it takes several of them.
    escape = _mm256_set_epi64x(escape_bytes[3], escape_bytes[2], escape_bytes[1], escape_bytes[0]);
    const __m256i step = _mm256_set_epi64x(step_bytes[3], step_bytes[2], step_bytes[1], step_bytes[0]);
    row = _mm256_or_si256(_mm256_add_epi8(step, _mm256_subs_epu8(escape, bytes(kFirstKind - 1))), none);
    return escape_ <= escapes_end_;
  }

  // False when escapes or room run out. `wrong`: not zero when a vertex is not known, or the front empty or too long.
  // Edges of starts are laid at `room`.
  LUMIGRID_HERE bool plan(Block& block, std::uint32_t room, __m256i& wrong) {
    __m256i row, escape;
    if (!tellApart(row, escape)) return false;
    const auto look = [&](const StepTables::Row& table) __attribute__((always_inline, LUMIGRID_AVX2)) {
      return _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(load(table.data())), row);
    };

    // Counts before each.
    const __m256i new_here = look(kStepTables.vertices);
    const __m256i pushed_here = look(kStepTables.pushed);
    const __m256i taken_here = look(kStepTables.taken);
    const __m256i new_sums = sumsOf(new_here);
    const __m256i pushed_sums = sumsOf(pushed_here);
    const __m256i taken_sums = sumsOf(taken_here);
    const __m256i vertices = words(state_.vertices), tails = words(state_.tail), heads = words(state_.head);
    state_.vertices += lastOf(new_sums);
    state_.tail += lastOf(pushed_sums);
    state_.head += lastOf(taken_sums);
    if (state_.vertices > header_.vertices) return false;

    const __m256i new_before = _mm256_sub_epi8(new_sums, new_here);
    const __m256i pushed_before = _mm256_sub_epi8(pushed_sums, pushed_here);
    const __m256i taken_before = _mm256_sub_epi8(taken_sums, taken_here);
    const __m256i is_near = _mm256_cmpeq_epi8(row, bytes(kEscape));
    const __m256i back = _mm256_and_si256(escape, is_near);
    const __m256i is_start = _mm256_cmpgt_epi8(row, bytes(kFirstRow + kStart - 1));
    const __m256i is_new = _mm256_cmpeq_epi8(row, _mm256_setzero_si256());
    const __m256i pattern = look(kStepTables.pattern);
    const __m256i corner_bytes = look(kStepTables.corner_bytes);
    const __m256i second = look(kStepTables.second);
    const __m256i is_last = look(kStepTables.last);
    const __m256i ring = words(mask_);
#pragma GCC unroll 2
    for (std::size_t half = 0; half < 2; ++half) {
      const auto part = [&](__m256i x) LUMIGRID_HERE {
        return half == 0 ? _mm256_castsi256_si128(x) : _mm256_extracti128_si256(x, 1);
      };
      const auto wide = [&](__m256i x) LUMIGRID_HERE { return _mm256_cvtepi8_epi16(part(x)); };
      // Vertices: the newest less what the escape says.
      const __m256i vertex = _mm256_add_epi16(vertices, wide(new_before));
      const __m256i third = _mm256_sub_epi16(_mm256_add_epi16(vertex, wide(is_near)), _mm256_cvtepu8_epi16(part(back)));
      _mm256_store_si256(reinterpret_cast<__m256i*>(block.third.data() + 16 * half), third);
      // The gates of others go behind all vertices, or to vertex 0, which is foreseen from nothing.
      const __m256i from = _mm256_blendv_epi8(words(header_.vertices + 1), third, wide(is_new));
      // A start stands where one edge too many was taken, and nowhere else.
      const __m256i tail = _mm256_add_epi16(tails, wide(pushed_before));
      const __m256i head = _mm256_add_epi16(heads, wide(taken_before));
      const __m256i starts = wide(is_start);
      const __m256i length = _mm256_sub_epi16(_mm256_sub_epi16(tail, head), starts);
      wrong = _mm256_or_si256(wrong, _mm256_subs_epu16(third, vertex));
      wrong = _mm256_or_si256(wrong, _mm256_subs_epu16(length, _mm256_andnot_si256(starts, ring)));
      // Places.
      const __m256i write = _mm256_and_si256(tail, ring);
      const __m256i first = _mm256_add_epi16(head, wide(second));
      const __m256i last = _mm256_sub_epi16(tail, words(1));
      const __m256i read = _mm256_and_si256(_mm256_blendv_epi8(first, last, wide(is_last)), ring);
      const __m256i offset = _mm256_add_epi16(_mm256_slli_epi16(wide(pattern), 6), wide(corner_bytes));
      const __m256i low0 = _mm256_unpacklo_epi16(offset, read), high0 = _mm256_unpacklo_epi16(write, from);
      const __m256i low4 = _mm256_unpackhi_epi16(offset, read), high4 = _mm256_unpackhi_epi16(write, from);
      auto* const to = reinterpret_cast<__m256i*>(block.step.data() + 16 * half);
      _mm256_store_si256(to, _mm256_unpacklo_epi32(low0, high0));
      _mm256_store_si256(to + 1, _mm256_unpackhi_epi32(low0, high0));
      _mm256_store_si256(to + 2, _mm256_unpacklo_epi32(low4, high4));
      _mm256_store_si256(to + 3, _mm256_unpackhi_epi32(low4, high4));
    }
    const auto rare =
        static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_cmpgt_epi8(row, bytes(kFirstRow + kKnown - 1))));
    return rare == 0 || planRare(block, rare, row, new_before, state_.vertices - lastOf(new_sums), room);
  }

  // Known vertices and starts. `new_before`: vertices before each step, beyond `vertices`.
  LUMIGRID_HERE bool planRare(Block& block, std::uint32_t rare, __m256i row, __m256i new_before, std::uint32_t vertices,
                              std::uint32_t room) {
    alignas(32) std::array<std::uint8_t, kStepsAtOnce> rows, before;
    _mm256_store_si256(reinterpret_cast<__m256i*>(rows.data()), row);
    _mm256_store_si256(reinterpret_cast<__m256i*>(before.data()), new_before);
    for (; rare != 0; rare &= rare - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(rare));
      std::uint32_t here = vertices + before[i];
      const std::uint32_t kind = rows[i] - kFirstRow;
      if (kind == kKnown) {
        std::array<std::uint32_t, 3> known{};
        if (!takeCorners(1, 1, here, known)) return false;
        block.third[i] = static_cast<std::uint16_t>(known[0]);
      } else {
        std::uint64_t& at = block.step[placeOf(i)];
        at = (at & ~std::uint64_t{0xFFFF0000}) | std::uint64_t{room} << 16;
        if (!takeEdge(kind - kStart, step_ + i, here, front_[room++])) return false;
      }
    }
    return true;
  }

  // The steps of a block, one after the other.
  LUMIGRID_HERE void follow(const Block& block, __m128i& gate, std::uint16_t*& corner) {
    std::uint64_t* const front = front_;
    std::uint64_t* const from = from_;
    const std::uint8_t* const patterns = kPatterns.data();
    const __m128i pushed_words = load(kPushedWords.data());
    __m128i edge = gate;
    auto* at = reinterpret_cast<std::uint8_t*>(corner);
    const auto store_edge = [](void* to, __m128i words) __attribute__((always_inline, LUMIGRID_AVX2)) {
      _mm_storel_epi64(static_cast<__m128i*>(to), words);
    };
    for (std::size_t half = 0; half < kStepsAtOnce; half += 16) {
      const std::uint64_t* const steps = block.step.data() + half;
      const std::uint16_t* const thirds = block.third.data() + half;
#pragma GCC unroll 16
      for (std::size_t i = 0; i < 16; ++i) {
        const std::uint64_t step = steps[placeOf(i)];
        const std::size_t offset = step & 0xFFFF;
        const std::uint8_t* const pattern = patterns + offset;
        const __m128i here = _mm_insert_epi16(
            _mm_loadl_epi64(reinterpret_cast<const __m128i*>(front + (step >> 16 & 0xFFFF))), thirds[i], 3);
        const __m128i eight = _mm_unpacklo_epi64(edge, here);
        const __m128i corners = _mm_shuffle_epi8(eight, load(pattern));
        store_edge(from + (step >> 48), edge);
        store_edge(at, corners);
        store_edge(front + (step >> 32 & 0xFFFF), _mm_shuffle_epi8(corners, pushed_words));
        edge = _mm_shuffle_epi8(eight, load(pattern + 16));
        at += offset % 8;
      }
    }
    gate = edge;
    corner = reinterpret_cast<std::uint16_t*>(at);
  }
#endif

  // One escape, on state_. Rare, and kept out of the way of the others.
  [[gnu::noinline]] bool leave() {
    State& s = state_;
    if (escape_ >= escapes_end_) return false;
    const std::uint32_t byte = *escape_++;
    const std::uint64_t a = s.gate & 0xFFFF;
    const std::uint64_t b = s.gate >> 16 & 0xFFFF;
    std::array<std::uint32_t, 3> third{s.vertices - 1U - byte};
    const std::uint32_t first_kind = isOld() ? kOldFirstKind : kFirstKind;
    const bool near = byte < first_kind;
    std::uint32_t kind = byte - first_kind;
    if (isOld()) {
      if (!near && kind < kOldPrevious) return start(kind - kOldStart);
      kind -= kOldPrevious;
      if (!near && kind > kCloseFirst) kind = kind == kCloseFirst + 1 ? kKnown : ~0U;
    } else if ((near || kind < kStart) && s.tail - s.head > mask_) {
      return false;
    }
    if (near || kind == kKnown) {
      if (near ? third[0] >= s.vertices : !takeCorners(1, 1, s.vertices, third)) return false;
      attach(a, b, third[0]);
      push(a, third[0], b);
      s.gate = packEdge(third[0], b, a);
      return true;
    }
    switch (kind) {
      case kPrevious: {
        --s.tail;
        const std::uint64_t previous = front_[s.tail & mask_] & 0xFFFF;
        attach(a, b, previous);
        s.gate = packEdge(previous, b, a);
        return true;
      }
      case kCloseLast:
        --s.tail;
        s.gate = front_[s.head++ & mask_];
        return true;
      case kCloseFirst:
        ++s.head;
        s.gate = front_[s.head++ & mask_];
        return true;
      case kFold: {
        const std::uint64_t second = front_[++s.head & mask_];
        attach(b, second & 0xFFFF, second >> 16 & 0xFFFF);
        return true;
      }
      default:
        return kind - kStart < 4 && start(kind - kStart);
    }
  }

  LUMIGRID_RARE bool start(std::uint32_t known_corners) {
    State& s = state_;
    std::array<std::uint32_t, 3> c{};
    if (!isOld()) {
      std::uint64_t edge = 0;
      if (s.tail - s.head != ~0U || !takeEdge(known_corners, step_, s.vertices, edge)) return false;
      --s.head;
      push(edge >> 16, edge, edge >> 32);
      s.gate = packEdge(edge & 0xFFFF, edge >> 16 & 0xFFFF, edge & 0xFFFF);
      return true;
    }
    // A triangle.
    if (!takeCorners(known_corners, 3, s.vertices, c)) return false;
    attach(c[0], c[1], c[2]);
    s.head = s.tail;
    push(c[0], c[2], c[1]);
    push(c[2], c[1], c[0]);
    s.gate = packEdge(c[1], c[0], c[2]);
    return true;
  }

  // The edge of a start: its corners, and the third corner of its triangle if that is new, as the next step says, else
  // the first again. `vertices` counts the new ones of the two.
  LUMIGRID_INLINE bool takeEdge(std::uint32_t known_corners, std::uint32_t step, std::uint32_t& vertices,
                                std::uint64_t& edge) {
    std::array<std::uint32_t, 3> c{};
    const bool good = takeCorners(known_corners, 2, vertices, c);
    const bool is_new = step + 1 < header_.steps && stepAt(step + 1) == kNewVertex;
    edge = packEdge(c[0], c[1], is_new ? vertices : c[0]);
    return good;
  }

  // Corners that are known, by their bits, come from the escapes' end, or are the next escapes before version 4. New
  // ones are foreseen from the corner before, the first from the newest vertex. Which are which cannot be foreseen:
  // what is written for one that is not new is written again.
  LUMIGRID_RARE bool takeCorners(std::uint32_t known_corners, std::uint32_t count, std::uint32_t& vertices,
                                 std::array<std::uint32_t, 3>& c) {
    bool good = true;
    std::uint64_t before = vertices > 0 ? vertices - 1 : 0;
    for (std::uint32_t k = 0; k < count; ++k) {
      const std::uint32_t is_known = known_corners >> k & 1U;
      from_[vertices] = packEdge(before, before, before);
      const std::uint8_t* const at = isOld() ? escape_ : escapes_end_ - 2;
      const std::uint32_t known = at[0] | static_cast<std::uint32_t>(at[1]) << 8;
      good = good && (is_known == 0 || known < vertices);
      (isOld() ? escape_ : escapes_end_) += isOld() ? 2 * is_known : 0 - std::size_t{2 * is_known};
      c[k] = is_known != 0 ? known : vertices;
      vertices += 1 - is_known;
      before = c[k];
    }
    return good && escape_ <= escapes_end_;
  }

  LUMIGRID_RARE void push(std::uint64_t a, std::uint64_t b, std::uint64_t opposite) {
    front_[state_.tail++ & mask_] = packEdge(a & 0xFFFF, b & 0xFFFF, opposite);
  }

  LUMIGRID_RARE void attach(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
    std::uint16_t* corner = indices_ + 3 * std::size_t{state_.triangles++};
    corner[0] = static_cast<std::uint16_t>(a);
    corner[1] = static_cast<std::uint16_t>(b);
    corner[2] = static_cast<std::uint16_t>(c);
  }

  const PatchHeader& header_;
  const std::uint8_t* steps_;
  const std::uint8_t* escape_;
  const std::uint8_t* escapes_end_;
  std::uint32_t mask_;
  std::uint64_t* front_;
  std::uint16_t* indices_;
  std::uint64_t* from_;
  std::uint32_t step_ = 0;
  State state_;
};

// Four vectors of four lanes, turned.
template <class V>
LUMIGRID_INLINE std::array<V, 4> transposed(const V* in) {
  const V low01 = __builtin_shufflevector(in[0], in[1], 0, 4, 1, 5);
  const V low23 = __builtin_shufflevector(in[2], in[3], 0, 4, 1, 5);
  const V high01 = __builtin_shufflevector(in[0], in[1], 2, 6, 3, 7);
  const V high23 = __builtin_shufflevector(in[2], in[3], 2, 6, 3, 7);
  return {__builtin_shufflevector(low01, low23, 0, 1, 4, 5), __builtin_shufflevector(low01, low23, 2, 3, 6, 7),
          __builtin_shufflevector(high01, high23, 0, 1, 4, 5), __builtin_shufflevector(high01, high23, 2, 3, 6, 7)};
}

// Encoding ----------------------------------------------------------------------------------------

void checkGeometry(const PatchGeometry& geometry) {
  LUMIGRID_CHECK_EQ(geometry.indices.size() % 3, 0U);
  LUMIGRID_CHECK(!geometry.indices.empty());
  LUMIGRID_CHECK_LE(geometry.indices.size() / 3, kMaxPatchTriangles);
  LUMIGRID_CHECK_LE(geometry.positions.size(), kMaxPatchVertices);
  LUMIGRID_CHECK_EQ(geometry.normals.size(), geometry.positions.size());
  if (!geometry.colors.empty()) LUMIGRID_CHECK_EQ(geometry.colors.size(), geometry.positions.size());
  std::uint16_t highest = 0;
  for (const std::uint16_t index : geometry.indices) highest = std::max(highest, index);
  LUMIGRID_CHECK_LT(std::size_t{highest}, geometry.positions.size());
  for (const glm::ivec3& q : geometry.positions)
    for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(q[axis] >= -kMaxLattice && q[axis] <= kMaxLattice);
}

// Positions relative to vertex 0 that lost `shift` bits.
void shiftedPoints(const PatchGeometry& geometry, const Connectivity& order, int shift, std::vector<Float4>& points) {
  points.clear();
  const glm::ivec3 corner = geometry.positions[order.vertices[0]];
  for (const std::uint32_t old : order.vertices) {
    const glm::ivec3 q = (geometry.positions[old] - corner) >> shift;
    points.push_back(Float4{static_cast<float>(q.x), static_cast<float>(q.y), static_cast<float>(q.z), 0.0F});
  }
}

Float4 magnitude(Float4 x) {
  return x < 0.0F ? -x : x;
}

// Whether all sums of facet normals are exact in floats. So are the sums of magnitudes here until one is too large,
// and they never shrink.
bool exactFacets(const std::vector<Float4>& points, const std::vector<std::uint16_t>& indices,
                 std::vector<Float4>& bounds) {
  bounds.assign(points.size(), Float4{});
  for (std::size_t t = 0; t < indices.size(); t += 3) {
    const Float4 a = magnitude(points[indices[t + 1]] - points[indices[t]]);
    const Float4 b = magnitude(points[indices[t + 2]] - points[indices[t]]);
    const Float4 bound = a * __builtin_shufflevector(b, b, 1, 2, 0, 3) + __builtin_shufflevector(a, a, 1, 2, 0, 3) * b;
    for (std::size_t k = 0; k < 3; ++k) bounds[indices[t + k]] += bound;
  }
  constexpr float kExactSum = 1 << 24;
  constexpr float kExactPoint = 1 << 23;
  Int4 beyond{};
  for (std::size_t v = 0; v < points.size(); ++v)
    beyond |= (bounds[v] >= kExactSum) | (magnitude(points[v]) >= kExactPoint);
  return (beyond[0] | beyond[1] | beyond[2]) == 0;
}

// Three planes of numbers given vertex by vertex, whole groups.
void writeLanes(base::ByteWriter& out, const std::vector<Uint4>& numbers, PlaneWriter& writer) {
  std::array<std::vector<std::uint32_t>, 3> planes;
  for (auto& plane : planes) plane.resize(numbers.size());
  for (std::size_t v = 0; v < numbers.size(); v += 4) {
    const auto turned = transposed(&numbers[v]);
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(&planes[k][v], &turned[k], sizeof(Uint4));
  }
  for (const auto& plane : planes) writer.write(out, plane);
}

// Differences to the places that the decoder will foresee, whole parallelograms or half ones.
std::vector<Uint4> placeNumbers(const std::vector<Uint4>& at, const Connectivity& order, int halving) {
  std::vector<Uint4> numbers(groupsOf(at.size()) * kGroup, Uint4{});
  for (std::size_t v = 1; v < at.size(); ++v) {
    const Edge& e = order.from[v];
    const Int4 across = reinterpret_cast<Int4>(at[e.b] - at[e.opposite]) >> halving;
    numbers[v] = zigzag(at[v] - (at[e.a] + reinterpret_cast<Uint4>(across)));
  }
  return numbers;
}

// About how many bits they take.
std::uint64_t sizeOf(const std::vector<Uint4>& numbers) {
  std::uint64_t bits = 0;
  for (std::size_t v = 0; v < numbers.size(); v += kGroup) {
    std::array<std::uint64_t, 3> sums{};
    for (std::size_t i = v; i < v + kGroup; ++i)
      for (std::size_t k = 0; k < 3; ++k) sums[k] += numbers[i][k];
    for (const std::uint64_t sum : sums) bits += static_cast<std::uint64_t>(std::bit_width(sum));
  }
  return bits;
}

// Of one patch; the flag says which of the two ways took less room.
std::vector<Uint4> choosePlaces(const PatchGeometry& geometry, const Connectivity& order, PatchHeader& header) {
  std::vector<Uint4> at;
  at.reserve(order.vertices.size());
  for (const std::uint32_t old : order.vertices) {
    const glm::uvec3 q(geometry.positions[old]);
    at.push_back(Uint4{q.x, q.y, q.z, 0U});
  }
  std::vector<Uint4> whole = placeNumbers(at, order, 0);
  std::vector<Uint4> half = placeNumbers(at, order, 1);
  if (sizeOf(whole) <= sizeOf(half)) return whole;
  header.flags |= kIsRough;
  return half;
}

// The least shift that keeps facet normals exact, and the points it leaves.
std::uint8_t chooseShift(const PatchGeometry& geometry, const Connectivity& order, std::vector<Float4>& points) {
  std::vector<Float4> bounds;
  points.reserve(order.vertices.size());
  for (std::uint8_t shift = 0; shift < kMaxFacetShift; ++shift) {
    shiftedPoints(geometry, order, shift, points);
    if (exactFacets(points, order.indices, bounds)) return shift;
  }
  shiftedPoints(geometry, order, kMaxFacetShift, points);
  return kMaxFacetShift;
}

// Differences of the normals' codes to those that the decoder will foresee from positions and triangles.
void writeNormals(base::ByteWriter& out, const PatchGeometry& geometry, const Connectivity& order,
                  const std::vector<Float4>& points, PlaneWriter& writer) {
  const std::size_t vertices = order.vertices.size();
  std::vector<Corner> sums(vertices);
  for (std::size_t v = 0; v < vertices; ++v) sums[v].point = points[v];
  sumFacets(order.indices.data(), order.triangles.size(), sums.data());

  std::array<std::vector<std::uint32_t>, 2> planes;
  for (auto& plane : planes) plane.resize(groupsOf(vertices) * kGroup, 0);
  Unit sum{}, given{};
  std::array<std::int32_t, kBlock> foreseen_u, foreseen_v, u, v;
  for (std::size_t first = 0; first < vertices; first += kBlock) {
    const std::size_t count = std::min(kBlock, vertices - first);
    for (std::size_t i = 0; i < count; ++i) {
      const Float4& s = sums[first + i].sum;
      sum.z[i] = s[0], sum.x[i] = s[1], sum.y[i] = s[2];
      const glm::vec3& n = geometry.normals[order.vertices[first + i]];
      given.x[i] = n.x, given.y[i] = n.y, given.z[i] = n.z;
    }
    predictNormals(sum.x, sum.y, sum.z, count, foreseen_u.data(), foreseen_v.data());
    encodeNormals(given, count, u.data(), v.data());
    // Modulo 256.
    const auto difference = [](std::int32_t a, std::int32_t b) {
      return zigzag(static_cast<std::int32_t>(static_cast<std::uint32_t>(a - b) << 24) >> 24);
    };
    for (std::size_t i = 0; i < count; ++i) {
      planes[0][first + i] = difference(u[i], foreseen_u[i]);
      planes[1][first + i] = difference(v[i], foreseen_v[i]);
    }
  }
  for (const auto& plane : planes) writer.write(out, plane);
}

void writeColors(base::ByteWriter& out, const PatchGeometry& geometry, const Connectivity& order, PlaneWriter& writer) {
  std::vector<Int4> codes;
  codes.reserve(order.vertices.size());
  for (const std::uint32_t old : order.vertices) codes.push_back(colorCode(geometry.colors[old]));
  std::vector<Uint4> numbers(groupsOf(codes.size()) * kGroup, Uint4{});
  numbers[0] = zigzag(reinterpret_cast<Uint4>(codes[0]));
  for (std::size_t v = 1; v < codes.size(); ++v) {
    const Int4 foreseen = (codes[order.from[v].a] + codes[order.from[v].b] + 1) >> 1;
    numbers[v] = zigzag(reinterpret_cast<Uint4>(codes[v] - foreseen));
  }
  writeLanes(out, numbers, writer);
}

void writeAlphas(base::ByteWriter& out, const PatchGeometry& geometry, const Connectivity& order, PlaneWriter& writer) {
  std::vector<std::uint32_t> plane(groupsOf(order.vertices.size()) * kGroup, 0);
  for (std::size_t v = 0; v < order.vertices.size(); ++v) plane[v] = zigzag(geometry.colors[order.vertices[v]].a - 255);
  writer.write(out, plane);
}

void writeHeader(base::ByteWriter& out, const PatchHeader& header) {
  out.u8(header.version);
  out.u8(header.flags);
  out.u16(static_cast<std::uint16_t>(header.vertices));
  out.u16(static_cast<std::uint16_t>(header.triangles));
  out.u8(header.facet_shift);
  out.u8(header.front_bits);
  out.write(header.corner);
  out.u32(header.steps);
  out.u32(header.escape_bytes);
  out.u32(header.crc);
}

// Everything but the checksum's own four bytes.
std::uint32_t checksum(base::ByteView bytes) {
  return base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
}

// Decoding ----------------------------------------------------------------------------------------

base::Error broken(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, "patch bytes: " + what};
}

base::Result<PatchHeader> readHeader(base::ByteView bytes) {
  if (bytes.size() < kHeaderBytes) return broken("cut short: the header alone has 32 bytes");
  base::ByteReader in(bytes);
  PatchHeader header;
  header.version = in.u8();
  if (header.version < kOldestVersion || header.version > kCodecVersion)
    return base::Error{base::ErrorCode::kVersion,
                       "patch bytes: codec version " + std::to_string(header.version) + ", this program reads 2 to 4"};

  header.flags = in.u8();
  header.vertices = in.u16();
  header.triangles = in.u16();
  header.facet_shift = in.u8();
  header.front_bits = in.u8();
  header.corner = in.read<glm::ivec3>();
  header.steps = in.u32();
  header.escape_bytes = in.u32();
  header.crc = in.u32();

  const int known = header.version == 2 ? kHasColors | kHasAlpha : kHasColors | kHasAlpha | kIsRough;
  if ((header.flags & ~known) != 0 || (header.alpha() && !header.colored())) return broken("unknown flags");
  if (header.vertices == 0 || header.triangles == 0) return broken("no triangles");
  if (header.facet_shift > kMaxFacetShift || header.front_bits > kMaxFrontBits) return broken("unknown parameters");
  const std::uint64_t stated = kHeaderBytes + header.stepBytes() + std::uint64_t{header.escape_bytes};
  if (stated > bytes.size()) return broken("cut short: the header says more than " + std::to_string(stated) + " bytes");
  return header;
}

// Differences to what the planes hold become numbers: lattice points, those relative to vertex 0 for facet normals, and
// colour codes. One pass, since each vertex waits for the one before. False when a point lies outside the lattice.
template <bool kColors>
LUMIGRID_INLINE bool addUp(const PatchHeader& header, const std::uint64_t* from, Scratch& scratch, glm::ivec3* out) {
  Uint4* at = scratch.positions.data();
  Uint4* color = scratch.colors.data();
  Corner* corners = Scratch::room(scratch.corners, groupsOf(header.vertices) * kGroup);
  const Uint4 corner{static_cast<std::uint32_t>(header.corner.x), static_cast<std::uint32_t>(header.corner.y),
                     static_cast<std::uint32_t>(header.corner.z), 0U};
  const Int4 shift = Int4{} + static_cast<std::int32_t>(header.facet_shift);
  const Int4 halving = Int4{} + header.halving();
  const Uint4 up = Uint4{} + header.roundsUp();
  at[0] += corner;
  const Uint4 origin = at[0];
  Int4 least = reinterpret_cast<Int4>(origin);
  Int4 greatest = least;
  const auto finish = [&](std::size_t v, Uint4 q) __attribute__((always_inline)) {
    const auto lattice = reinterpret_cast<Int4>(q);
    least = lattice < least ? lattice : least;
    greatest = lattice > greatest ? lattice : greatest;
    corners[v] = {__builtin_convertvector(reinterpret_cast<Int4>(q - origin) >> shift, Float4), Float4{}};
    // The fourth lane falls on the next.
    std::memcpy(reinterpret_cast<std::uint8_t*>(out + v), &q, sizeof(q));
  };
  finish(0, origin);
  const std::size_t vertices = header.vertices;
  for (std::size_t v = 1; v < vertices; ++v) {
    const std::uint64_t e = from[v];
    const std::size_t a = e & 0xFFFF;
    const std::size_t b = e >> 16 & 0xFFFF;
    const std::size_t opposite = e >> 32 & 0xFFFF;
    // A is most often the vertex before: it comes last, so that little waits for it.
    const Uint4 q = at[v] + reinterpret_cast<Uint4>(reinterpret_cast<Int4>(at[b] - at[opposite]) >> halving) + at[a];
    at[v] = q;
    finish(v, q);
    if (kColors) color[v] += reinterpret_cast<Uint4>(reinterpret_cast<Int4>(color[b] + up + color[a]) >> 1);
  }
  bool inside = true;
  for (int axis = 0; axis < 3; ++axis) inside = inside && least[axis] >= -kMaxLattice && greatest[axis] <= kMaxLattice;
  return inside;
}

// In whole groups, as are the codes of colours below.
LUMIGRID_INLINE void addNormals(const PatchHeader& header, const std::uint16_t* indices, Scratch& scratch,
                                glm::vec3* out) {
  const std::size_t count = groupsOf(header.vertices) * kGroup;
  Corner* corners = scratch.corners.data();
  for (std::size_t v = header.vertices; v < count; ++v) corners[v] = {};
  sumFacets(indices, header.triangles, corners);

  std::array<float, kBlock> x, y, z;
  std::array<std::int32_t, kBlock> u, w;
  Unit unit;
  for (std::size_t first = 0; first < count; first += kBlock) {
    const std::size_t part = std::min(kBlock, count - first);
    for (std::size_t i = 0; i < part; i += 4) {
      const Corner* c = corners + first + i;
      const Float4 sums[4] = {c[0].sum, c[1].sum, c[2].sum, c[3].sum};
      const auto lanes = transposed(sums);
      std::memcpy(&z[i], &lanes[0], sizeof(Float4));
      std::memcpy(&x[i], &lanes[1], sizeof(Float4));
      std::memcpy(&y[i], &lanes[2], sizeof(Float4));
    }
    predictNormals(x, y, z, part, u.data(), w.data());
    // Modulo 256, as the encoder's difference.
    const auto low_byte = [](std::uint32_t n) { return static_cast<std::int32_t>(n << 24) >> 24; };
    for (std::size_t i = 0; i < part; ++i) {
      u[i] = low_byte(static_cast<std::uint32_t>(u[i]) + scratch.normal_u[first + i]);
      w[i] = low_byte(static_cast<std::uint32_t>(w[i]) + scratch.normal_v[first + i]);
    }
    decodeNormals(u.data(), w.data(), part, unit);
    for (std::size_t i = 0; i < part; i += 4) {
      Float4 lanes[4] = {};
      std::memcpy(&lanes[0], &unit.x[i], sizeof(Float4));
      std::memcpy(&lanes[1], &unit.y[i], sizeof(Float4));
      std::memcpy(&lanes[2], &unit.z[i], sizeof(Float4));
      const auto four = transposed(lanes);
      // The fourth lane falls on the next.
      for (std::size_t k = 0; k < 4; ++k)
        std::memcpy(reinterpret_cast<std::uint8_t*>(out + first + i + k), &four[k], sizeof(Float4));
    }
  }
}

LUMIGRID_INLINE void addColors(const PatchHeader& header, const Uint4* codes, const std::uint32_t* alphas,
                               glm::u8vec4* out) {
  const Uint4 opaque = Uint4{} + 255;
  for (std::size_t v = 0; v < header.vertices; v += 4) {
    const auto [luma, orange, green, unused] = transposed(codes + v);
    Uint4 alpha{};
    if (header.alpha()) std::memcpy(&alpha, alphas + v, sizeof(alpha));
    const Uint4 rgba = codeColors(luma, orange, green, alpha + opaque);
    std::memcpy(&out[v], &rgba, sizeof(rgba));
  }
}

// Three planes, vertex by vertex: coordinates, or channels. The fourth lane is zero.
LUMIGRID_INLINE bool readLanes(PlaneReader readPlane, base::ByteView in, std::size_t& at, std::size_t groups,
                               Scratch& scratch, Uint4* out) {
  const std::size_t padded = groups * kGroup;
  std::array<const std::uint32_t*, 3> plane{};
  for (std::size_t k = 0; k < 3; ++k) {
    std::uint32_t* room = Scratch::room(scratch.planes[k], padded);
    if (!readPlane(in, at, groups, scratch.planeRoom(groups), room)) return false;
    plane[k] = room;
  }
  for (std::size_t v = 0; v < padded; v += 4) {
    Uint4 four[4] = {};
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(&four[k], plane[k] + v, sizeof(Uint4));
    const auto turned = transposed(four);
    for (std::size_t k = 0; k < 4; ++k) out[v + k] = turned[k];
  }
  return true;
}

// What stands in the way, or null.
LUMIGRID_INLINE const char* decodeParts(const PatchHeader& header, base::ByteView bytes, PlaneReader readPlane,
                                        bool (Machine::*run)(), PatchGeometry& geometry) {
  // A copy with sixteen bytes behind it: whole words are read at any place.
  thread_local Scratch scratch;
  std::uint8_t* copy = Scratch::room(scratch.bytes, bytes.size() + 16);
  std::memcpy(copy, bytes.data(), bytes.size());
  std::memset(copy + bytes.size(), 0, 16);
  const base::ByteView in(copy, bytes.size());

  // Triangles, and what each vertex is predicted from.
  std::uint16_t* indices = Scratch::room(scratch.indices, (std::size_t{header.triangles} + kSlack) * 3);
  scratch.front.assign((std::size_t{1} << header.front_bits) + Machine::kBehindRing, 0);
  std::uint64_t* from = Scratch::room(scratch.from, header.vertices + kSlack);
  const base::ByteView steps = in.subspan(kHeaderBytes, header.stepBytes());
  const base::ByteView escapes = in.subspan(kHeaderBytes + steps.size(), header.escape_bytes);
  Machine machine(header, steps, escapes, scratch.front.data(), indices, from);
  if (!(machine.*run)()) return "the triangles do not decode";

  // Planes.
  const std::size_t groups = groupsOf(header.vertices);
  const std::size_t padded = groups * kGroup;
  Uint4* positions = Scratch::room(scratch.positions, padded);
  const PlaneRoom room = scratch.planeRoom(groups);
  std::size_t at = kHeaderBytes + steps.size() + escapes.size();
  bool whole = readLanes(readPlane, in, at, groups, scratch, positions);
  whole = whole && readPlane(in, at, groups, room, Scratch::room(scratch.normal_u, padded));
  whole = whole && readPlane(in, at, groups, room, Scratch::room(scratch.normal_v, padded));
  Uint4* colors = header.colored() ? Scratch::room(scratch.colors, padded) : nullptr;
  if (header.colored()) whole = whole && readLanes(readPlane, in, at, groups, scratch, colors);
  std::uint32_t* alphas = header.alpha() ? Scratch::room(scratch.alphas, padded) : nullptr;
  if (header.alpha()) whole = whole && readPlane(in, at, groups, room, alphas);
  if (!whole || at != bytes.size()) return "the vertices do not decode";

  // Numbers into vertices.
  glm::ivec3* points = Scratch::room(scratch.lattice, header.vertices + 1U);
  if (!(header.colored() ? addUp<true>(header, from, scratch, points) : addUp<false>(header, from, scratch, points)))
    return "a vertex lies outside the lattice";
  glm::vec3* normals = Scratch::room(scratch.normals, padded + 1);
  addNormals(header, indices, scratch, normals);
  geometry.indices.assign(indices, indices + std::size_t{header.triangles} * 3);
  geometry.positions.assign(points, points + header.vertices);
  geometry.normals.assign(normals, normals + header.vertices);
  if (header.colored()) {
    glm::u8vec4* rgba = Scratch::room(scratch.rgba, padded);
    addColors(header, colors, alphas, rgba);
    geometry.colors.assign(rgba, rgba + header.vertices);
  }
  return nullptr;
}

#if defined(__x86_64__)
__attribute__((LUMIGRID_AVX2)) const char* decodeByAvx2(const PatchHeader& header, base::ByteView bytes,
                                                        PatchGeometry& geometry) {
  return decodeParts(header, bytes, readPlaneByAvx2<findOnesByAvx2>, &Machine::runByAvx2, geometry);
}

__attribute__((LUMIGRID_AVX2)) const char* decodeByAvx512(const PatchHeader& header, base::ByteView bytes,
                                                          PatchGeometry& geometry) {
  return decodeParts(header, bytes, readPlaneByAvx2<findOnesByAvx512>, &Machine::runByAvx2, geometry);
}
#endif

const char* decodeAnywhere(const PatchHeader& header, base::ByteView bytes, PatchGeometry& geometry) {
  return decodeParts(header, bytes, readPlaneAnywhere, &Machine::run, geometry);
}

using Decoder = const char* (*)(const PatchHeader&, base::ByteView, PatchGeometry&);

Decoder fastestDecoder([[maybe_unused]] bool may_use_avx512) {
#if defined(__x86_64__)
  const bool has_avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("bmi") != 0 &&
                        __builtin_cpu_supports("bmi2") != 0 && __builtin_cpu_supports("popcnt") != 0;
  const bool has_avx512 = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                          __builtin_cpu_supports("avx512vbmi2") != 0;
  if (has_avx2) return has_avx512 && may_use_avx512 ? decodeByAvx512 : decodeByAvx2;
#endif
  return decodeAnywhere;
}

base::Result<PatchGeometry> decodeBy(Decoder decode, base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readHeader(bytes));
#if !defined(__EMSCRIPTEN__)
  // All of it is on its way before the checksum waits for the first of it.
  for (std::size_t i = 0; i < bytes.size(); i += 64) __builtin_prefetch(bytes.data() + i);
#endif
  if (checksum(bytes) != header.crc) return broken("checksum does not match");
  PatchGeometry geometry;
  if (const char* fault = decode(header, bytes, geometry)) return broken(fault);
  return geometry;
}

}  // namespace

base::Bytes encodePatch(const PatchGeometry& geometry) {
  return encodePatch(geometry, nullptr);
}

base::Bytes encodePatch(const PatchGeometry& geometry, std::vector<std::uint32_t>* triangle_order) {
  checkGeometry(geometry);
  const Connectivity order = walk(geometry);
  std::vector<Float4> points;

  PatchHeader header;
  header.vertices = static_cast<std::uint32_t>(order.vertices.size());
  header.triangles = static_cast<std::uint32_t>(order.triangles.size());
  header.facet_shift = chooseShift(geometry, order, points);
  header.front_bits = order.front_bits;
  header.corner = geometry.positions[order.vertices[0]];
  header.steps = order.steps;
  header.escape_bytes = static_cast<std::uint32_t>(order.escapes.size());
  const auto opaque = [&](std::uint32_t old) { return geometry.colors[old].a == 255; };
  if (!geometry.colors.empty()) {
    header.flags |= kHasColors;
    if (!std::all_of(order.vertices.begin(), order.vertices.end(), opaque)) header.flags |= kHasAlpha;
  }

  const std::vector<Uint4> places = choosePlaces(geometry, order, header);
  base::ByteWriter out;
  writeHeader(out, header);
  out.bytes(order.step_bytes);
  out.bytes(order.escapes);
  PlaneWriter writer(groupsOf(order.vertices.size()) * kGroup);
  writeLanes(out, places, writer);
  writeNormals(out, geometry, order, points, writer);
  if (header.colored()) writeColors(out, geometry, order, writer);
  if (header.alpha()) writeAlphas(out, geometry, order, writer);
  out.patch(kCrcOffset, checksum(out.view()));
  if (triangle_order != nullptr) *triangle_order = order.triangles;
  return out.take();
}

base::Result<PatchGeometry> decodePatch(base::ByteView bytes) {
  static const Decoder decoder = fastestDecoder(true);
  return decodeBy(decoder, bytes);
}

base::Result<PatchGeometry> decodePatchByAvx2(base::ByteView bytes) {
  return decodeBy(fastestDecoder(false), bytes);
}

base::Result<PatchGeometry> decodePatchPortably(base::ByteView bytes) {
  return decodeBy(decodeAnywhere, bytes);
}

base::Result<PatchCounts> encodedCounts(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readHeader(bytes));
  return PatchCounts{header.vertices, header.triangles};
}

void quantizeNormals(std::span<glm::vec3> normals) {
  Unit unit;
  std::array<std::int32_t, kBlock> u, v;
  for (std::size_t first = 0; first < normals.size(); first += kBlock) {
    const std::span<glm::vec3> block = normals.subspan(first, std::min(kBlock, normals.size() - first));
    for (std::size_t i = 0; i < block.size(); ++i)
      unit.x[i] = block[i].x, unit.y[i] = block[i].y, unit.z[i] = block[i].z;
    encodeNormals(unit, block.size(), u.data(), v.data());
    decodeNormals(u.data(), v.data(), block.size(), unit);
    for (std::size_t i = 0; i < block.size(); ++i) block[i] = {unit.x[i], unit.y[i], unit.z[i]};
  }
}

glm::vec3 quantizedNormal(const glm::vec3& n) {
  glm::vec3 quantized = n;
  quantizeNormals({&quantized, 1});
  return quantized;
}

glm::u8vec4 quantizedColor(const glm::u8vec4& color) {
  const auto channel = [](std::uint8_t c) { return levelByte(kLevelOfByte[c]); };
  return {channel(color.r), channel(color.g), channel(color.b), color.a};
}

}  // namespace lod::patch
