#include "lod/patch/codec/connectivity_decoder.h"

#include <array>
#include <bit>
#include <cstring>

#include "lod/patch/codec/connectivity.h"
#include "lod/patch/codec/processors.h"
#include "lod/patch/codec/residuals.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace lod::patch::codec {
namespace {

// The effects of a step other than an escape, as masks and counts: no branch has to be predicted.
struct StepEffect {
  std::uint64_t is_new, is_next, is_none;
  std::uint32_t pushed, taken, corners, unused;
};
constexpr std::array<StepEffect, 3> kStepEffects{
    {{~0ULL, 0, 0, 1, 0, 3, 0}, {0, ~0ULL, 0, 0, 1, 3, 0}, {0, 0, ~0ULL, 0, 1, 0, 0}}};

#if defined(__x86_64__)
// With vectors, 32 steps and their escapes are classified at once. Where each reads and writes follows from sums over
// those before it, whatever their edges are. Then each step is a shuffle of eight words: the gate's a, b, opposite and
// nothing; a, b, opposite of the edge that it reads; a vertex. Only known vertices and starts need branches.
enum : std::uint8_t { kTake, kAttach, kAttachFirst, kAttachLast, kFoldPair, kStartEdge, kPatternCount };
constexpr std::size_t kPatternBytes = 64;
constexpr std::size_t kCornerBytes = 6;
// Shuffles of 16-bit words as _mm_shuffle_epi8 takes them; the upper 80 bits of the result are zero.
using Shuffle = std::array<std::uint8_t, 16>;
constexpr Shuffle threeWords(std::uint8_t a, std::uint8_t b, std::uint8_t c) {
  Shuffle bytes{};
  const std::array<std::uint8_t, 3> words{a, b, c};
  for (std::size_t k = 0; k < bytes.size(); ++k)
    bytes[k] = k < kCornerBytes ? static_cast<std::uint8_t>(2 * words[k / 2] + k % 2) : std::uint8_t{0x80};
  return bytes;
}
// Per pattern, the words that make up its triangle and those that make up the next gate. A pattern with a triangle lies
// kCornerBytes behind its multiple of kPatternBytes, so that its offset alone tells how far the corners advance.
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
// The edge (a, third, b) that a corner triple (a, b, third) pushes.
alignas(16) constexpr Shuffle kPushedWords = threeWords(0, 2, 1);

// Columns: steps 0 to 2; 3, an escape to a vertex before the newest; the kinds of escapes from 4 on, a start in four
// columns by its known corners.
struct StepTables {
  using Row = std::array<std::int8_t, 16>;
  Row pattern{kAttach,   kAttachFirst, kTake,      kAttach,    kAttachLast, kTake,     kTake,
              kFoldPair, kAttach,      kStartEdge, kStartEdge, kStartEdge,  kStartEdge};
  Row corner_bytes{6, 6, 0, 6, 6, 0, 0, 6, 6};
  Row vertices{1, 0, 0, 0, 0, 0, 0, 0, 0, 2, 1, 1, 0};
  Row pushed{1, 0, 0, 1, -1, -1, 0, 0, 1, 1, 1, 1, 1};
  Row taken{0, 1, 1, 0, 0, 1, 2, 1, 0, -1, -1, -1, -1};
  Row second{0, 0, 0, 0, 0, 0, 1, 1};  // 1: reads the front's second edge instead of the first
  Row last{0, 0, 0, 0, -1};            // −1: reads the last edge
};
alignas(16) constexpr StepTables kStepTables{};
constexpr std::uint32_t kFirstEscape = 4;
constexpr std::uint8_t kNoStep = 0x80;  // zero in every table
#endif

class ConnectivityDecoder {
 public:
  ConnectivityDecoder(const PatchHeader& header, const ConnectivityInput& in, const ConnectivityOutput& out)
      : header_(header),
        steps_(in.steps.data()),
        escape_(in.escapes.data()),
        escapes_end_(in.escapes.data() + in.escapes.size()),
        mask_((1U << header.front_bits) - 1),
        front_(out.front),
        indices_(out.indices),
        gates_(out.gates) {}

  bool decode() {
    // Members are copied: no store can change the copies, so they stay in registers.
    std::uint64_t* const front = front_;
    std::uint64_t* const gates = gates_;
    std::uint16_t* const indices = indices_;
    const std::uint32_t mask = mask_;
    std::uint64_t gate = 0;
    // A start gives back the edge that was taken from an empty front.
    std::uint32_t head = 1;
    std::uint32_t tail = 0;
    std::uint32_t vertices = 0;
    std::uint16_t* corner = indices;
    const auto advance = [&](std::uint32_t i, std::uint32_t step) __attribute__((always_inline)) {
      if (step == kEscape) [[unlikely]] {
        step_ = i;
        state_ = {gate, head, tail, vertices, static_cast<std::uint32_t>((corner - indices) / 3)};
        const bool good = decodeEscape();
        gate = state_.gate, head = state_.head, tail = state_.tail;
        vertices = state_.vertices, corner = indices + 3 * std::size_t{state_.triangles};
        return good;
      }
      if (tail - head > mask) return false;
      // All three effects are computed and masks keep one, since no branch could predict which it is.
      constexpr std::uint64_t kA = 0xFFFF, kB = kA << 16, kOpposite = kA << 32;
      const StepEffect& effect = kStepEffects[step];
      const std::uint64_t next = front[head & mask];
      const std::uint64_t end = next >> 16 & kA;
      const std::uint64_t third = end ^ ((end ^ vertices) & effect.is_new);
      const std::uint64_t corners = (gate & (kA | kB)) | third << 32;
      std::memcpy(corner, &corners, sizeof(corners));
      gates[vertices] = gate;
      // The two new edges: (a, third, b), and (third, b, a).
      const std::uint64_t left = (gate & kA) | (gate << 16 & kOpposite) | third << 16;
      const std::uint64_t right = third | (gate & kB) | gate << 32;
      front[tail & mask] = left;
      gate = (right & effect.is_new) | (left & effect.is_next) | (next & effect.is_none);
      tail += effect.pushed;
      vertices += effect.pushed;
      head += effect.taken;
      corner += effect.corners;
      return true;
    };

    const std::uint8_t* const steps = steps_;
    const std::uint32_t count = header_.steps;
    const std::uint32_t max_vertices = header_.vertices;
    const std::uint16_t* const last = indices + 3 * std::size_t{header_.triangles};
    for (std::uint32_t i = 0; i < count; ++i) {
      const bool good = advance(i, steps[i / 4] >> (2 * (i % 4)) & 3U);
      if (!good || vertices > max_vertices || corner > last) return false;
    }
    return vertices == max_vertices && corner == last && escape_ == escapes_end_ && tail - head <= mask;
  }

#if defined(__x86_64__)
  __attribute__((LUMIGRID_AVX2)) bool decodeByAvx2() {
    if (header_.front_bits > kMaxVectorBits) return decode();
    const std::uint16_t* const last = indices_ + 3 * std::size_t{header_.triangles};
    __m128i gate = _mm_setzero_si128();
    std::uint16_t* corner = indices_;
    std::array<Block, kBlocks> blocks;
    state_ = {0, 1, 0, 0, 0};
    __m256i wrong = _mm256_setzero_si256();
    for (step_ = 0; step_ < header_.steps;) {
      std::size_t planned = 0;
      for (; planned < kBlocks && step_ < header_.steps; ++planned, step_ += kStepsAtOnce)
        if (!planBlock(blocks[planned], mask_ + 1 + static_cast<std::uint32_t>(kStepsAtOnce * planned), wrong))
          return false;
      for (std::size_t b = 0; b < planned; ++b) {
        followBlock(blocks[b], gate, corner);
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

  std::uint32_t stepAt(std::uint32_t i) const {
    return steps_[i / 4] >> (2 * (i % 4)) & 3U;
  }

#if defined(__x86_64__)
  // Places and counters have 16-bit lanes here. Longer fronts, which scans do not have, are decoded step by step.
  static constexpr std::uint8_t kMaxVectorBits = 14;

  // Planned steps. Per step, `third` has the new or known vertex of its triangle. `step` has, from the lowest 16 bits
  // up, the offset of its pattern, the place where it reads the front, the place where it writes it, and the vertex
  // whose gate it stores: one word, since a step touches memory eight times as it is.
  struct alignas(32) Block {
    std::array<std::uint16_t, kStepsAtOnce> third;
    std::array<std::uint64_t, kStepsAtOnce> step;
  };
  // Where step i lies: each sixteen were interleaved within halves of registers.
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
  // In each byte the sum of it and all before it.
  LUMIGRID_HERE static __m256i prefixSums(__m256i x) {
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 1));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 2));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 4));
    x = _mm256_add_epi8(x, _mm256_slli_si256(x, 8));
    return _mm256_add_epi8(x, _mm256_shuffle_epi8(_mm256_permute2x128_si256(x, x, 0x08), _mm256_set1_epi8(15)));
  }
  LUMIGRID_HERE static std::uint32_t lastOf(__m256i sums) {
    return static_cast<std::uint32_t>(static_cast<std::int8_t>(_mm256_extract_epi8(sums, 31)));
  }

  // Classifies the next steps: their columns in kStepTables, and their escapes at the places of the steps. False when
  // escapes run out.
  LUMIGRID_HERE bool classify(__m256i& column, __m256i& escape) {
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
    // The registers are put together from words, since a load of all four would wait for their stores.
    escape = _mm256_set_epi64x(escape_bytes[3], escape_bytes[2], escape_bytes[1], escape_bytes[0]);
    const __m256i step = _mm256_set_epi64x(step_bytes[3], step_bytes[2], step_bytes[1], step_bytes[0]);
    column = _mm256_or_si256(_mm256_add_epi8(step, _mm256_subs_epu8(escape, bytes(kFirstKind - 1))), none);
    return escape_ <= escapes_end_;
  }

  // Plans the next kStepsAtOnce steps. False when escapes run out or vertices are too many. `wrong` becomes other than
  // zero when a vertex is not known, or the front empty or too long. Edges of starts are stored at front place `room`.
  LUMIGRID_HERE bool planBlock(Block& block, std::uint32_t room, __m256i& wrong) {
    __m256i column, escape;
    if (!classify(column, escape)) return false;
    const auto lookUp = [&](const StepTables::Row& table) __attribute__((always_inline, LUMIGRID_AVX2)) {
      return _mm256_shuffle_epi8(_mm256_broadcastsi128_si256(load(table.data())), column);
    };

    // Counts up to and before each step.
    const __m256i new_here = lookUp(kStepTables.vertices);
    const __m256i pushed_here = lookUp(kStepTables.pushed);
    const __m256i taken_here = lookUp(kStepTables.taken);
    const __m256i new_sums = prefixSums(new_here);
    const __m256i pushed_sums = prefixSums(pushed_here);
    const __m256i taken_sums = prefixSums(taken_here);
    const __m256i vertices = words(state_.vertices), tails = words(state_.tail), heads = words(state_.head);
    state_.vertices += lastOf(new_sums);
    state_.tail += lastOf(pushed_sums);
    state_.head += lastOf(taken_sums);
    if (state_.vertices > header_.vertices) return false;

    const __m256i new_before = _mm256_sub_epi8(new_sums, new_here);
    const __m256i pushed_before = _mm256_sub_epi8(pushed_sums, pushed_here);
    const __m256i taken_before = _mm256_sub_epi8(taken_sums, taken_here);
    const __m256i is_near = _mm256_cmpeq_epi8(column, bytes(kEscape));
    const __m256i back = _mm256_and_si256(escape, is_near);
    const __m256i is_start = _mm256_cmpgt_epi8(column, bytes(kFirstEscape + kStart - 1));
    const __m256i is_new = _mm256_cmpeq_epi8(column, _mm256_setzero_si256());
    const __m256i pattern = lookUp(kStepTables.pattern);
    const __m256i corner_bytes = lookUp(kStepTables.corner_bytes);
    const __m256i second = lookUp(kStepTables.second);
    const __m256i is_last = lookUp(kStepTables.last);
    const __m256i ring = words(mask_);
#pragma GCC unroll 2
    for (std::size_t half = 0; half < 2; ++half) {
      const auto part = [&](__m256i x) LUMIGRID_HERE {
        return half == 0 ? _mm256_castsi256_si128(x) : _mm256_extracti128_si256(x, 1);
      };
      const auto wide = [&](__m256i x) LUMIGRID_HERE { return _mm256_cvtepi8_epi16(part(x)); };
      // The vertex: the next new one, or the newest less what the escape says.
      const __m256i vertex = _mm256_add_epi16(vertices, wide(new_before));
      const __m256i third = _mm256_sub_epi16(_mm256_add_epi16(vertex, wide(is_near)), _mm256_cvtepu8_epi16(part(back)));
      _mm256_store_si256(reinterpret_cast<__m256i*>(block.third.data() + 16 * half), third);
      // Gates of steps without a new vertex go behind all vertices, or to vertex 0, which has no prediction.
      const __m256i gate = _mm256_blendv_epi8(words(header_.vertices + 1), third, wide(is_new));
      // A start comes where one edge too many was taken, and nowhere else.
      const __m256i tail = _mm256_add_epi16(tails, wide(pushed_before));
      const __m256i head = _mm256_add_epi16(heads, wide(taken_before));
      const __m256i starts = wide(is_start);
      const __m256i length = _mm256_sub_epi16(_mm256_sub_epi16(tail, head), starts);
      wrong = _mm256_or_si256(wrong, _mm256_subs_epu16(third, vertex));
      wrong = _mm256_or_si256(wrong, _mm256_subs_epu16(length, _mm256_andnot_si256(starts, ring)));
      // Places in the ring.
      const __m256i write = _mm256_and_si256(tail, ring);
      const __m256i first = _mm256_add_epi16(head, wide(second));
      const __m256i last = _mm256_sub_epi16(tail, words(1));
      const __m256i read = _mm256_and_si256(_mm256_blendv_epi8(first, last, wide(is_last)), ring);
      const __m256i offset = _mm256_add_epi16(_mm256_slli_epi16(wide(pattern), 6), wide(corner_bytes));
      const __m256i low0 = _mm256_unpacklo_epi16(offset, read), high0 = _mm256_unpacklo_epi16(write, gate);
      const __m256i low4 = _mm256_unpackhi_epi16(offset, read), high4 = _mm256_unpackhi_epi16(write, gate);
      auto* const to = reinterpret_cast<__m256i*>(block.step.data() + 16 * half);
      _mm256_store_si256(to, _mm256_unpacklo_epi32(low0, high0));
      _mm256_store_si256(to + 1, _mm256_unpackhi_epi32(low0, high0));
      _mm256_store_si256(to + 2, _mm256_unpacklo_epi32(low4, high4));
      _mm256_store_si256(to + 3, _mm256_unpackhi_epi32(low4, high4));
    }
    const auto rare =
        static_cast<std::uint32_t>(_mm256_movemask_epi8(_mm256_cmpgt_epi8(column, bytes(kFirstEscape + kKnown - 1))));
    return rare == 0 || planRare(block, rare, column, new_before, state_.vertices - lastOf(new_sums), room);
  }

  // Plans known vertices and starts, the steps whose bits are set in `rare`. `new_before`: new vertices before each
  // step, beyond `vertices`.
  LUMIGRID_HERE bool planRare(Block& block, std::uint32_t rare, __m256i column, __m256i new_before,
                              std::uint32_t vertices, std::uint32_t room) {
    alignas(32) std::array<std::uint8_t, kStepsAtOnce> columns, before;
    _mm256_store_si256(reinterpret_cast<__m256i*>(columns.data()), column);
    _mm256_store_si256(reinterpret_cast<__m256i*>(before.data()), new_before);
    for (; rare != 0; rare &= rare - 1) {
      const auto i = static_cast<std::uint32_t>(std::countr_zero(rare));
      std::uint32_t here = vertices + before[i];
      const std::uint32_t kind = columns[i] - kFirstEscape;
      if (kind == kKnown) {
        std::array<std::uint32_t, 2> known{};
        if (!readCorners(1, 1, here, known)) return false;
        block.third[i] = static_cast<std::uint16_t>(known[0]);
      } else {
        std::uint64_t& at = block.step[placeOf(i)];
        at = (at & ~std::uint64_t{0xFFFF0000}) | std::uint64_t{room} << 16;
        if (!readStartEdge(kind - kStart, step_ + i, here, front_[room++])) return false;
      }
    }
    return true;
  }

  // Follows the planned steps one after the other.
  LUMIGRID_HERE void followBlock(const Block& block, __m128i& gate, std::uint16_t*& corner) {
    std::uint64_t* const front = front_;
    std::uint64_t* const gates = gates_;
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
        store_edge(gates + (step >> 48), edge);
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

  // Decodes one escape, on state_. It seldom runs, and is kept out of the way of the other steps.
  [[gnu::noinline]] bool decodeEscape() {
    State& s = state_;
    if (escape_ >= escapes_end_) return false;
    const std::uint32_t byte = *escape_++;
    const bool is_near = byte < kFirstKind;
    const std::uint32_t kind = byte - kFirstKind;
    if ((is_near || kind < kStart) && s.tail - s.head > mask_) return false;
    const std::uint64_t a = s.gate & 0xFFFF;
    const std::uint64_t b = s.gate >> 16 & 0xFFFF;
    if (is_near || kind == kKnown) {
      std::array<std::uint32_t, 2> third{s.vertices - 1U - byte};
      if (is_near ? third[0] >= s.vertices : !readCorners(1, 1, s.vertices, third)) return false;
      addTriangle(a, b, third[0]);
      pushEdge(a, third[0], b);
      s.gate = packEdge(third[0], b, a);
      return true;
    }
    switch (kind) {
      case kPrevious: {
        --s.tail;
        const std::uint64_t previous = front_[s.tail & mask_] & 0xFFFF;
        addTriangle(a, b, previous);
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
        addTriangle(b, second & 0xFFFF, second >> 16 & 0xFFFF);
        return true;
      }
      default:
        return startComponent(kind - kStart);
    }
  }

  LUMIGRID_RARE bool startComponent(std::uint32_t known_corners) {
    State& s = state_;
    std::uint64_t edge = 0;
    if (s.tail - s.head != ~0U || !readStartEdge(known_corners, step_, s.vertices, edge)) return false;
    --s.head;
    pushEdge(edge >> 16, edge, edge >> 32);
    s.gate = packEdge(edge & 0xFFFF, edge >> 16 & 0xFFFF, edge & 0xFFFF);
    return true;
  }

  // The edge of a start: its ends, and the third corner of its triangle if the next step says that this is new, else
  // the first end again. `vertices` counts the new ones of the two ends.
  LUMIGRID_ALWAYS_INLINE bool readStartEdge(std::uint32_t known_corners, std::uint32_t step, std::uint32_t& vertices,
                                            std::uint64_t& edge) {
    std::array<std::uint32_t, 2> c{};
    const bool good = readCorners(known_corners, 2, vertices, c);
    const bool is_new = step + 1 < header_.steps && stepAt(step + 1) == kNewVertex;
    edge = packEdge(c[0], c[1], is_new ? vertices : c[0]);
    return good;
  }

  // The first `count` corners: those whose bits are set in `known_corners` are read from the escapes' end, others are
  // new and predicted from the corner before, the first from the newest vertex. No branch could predict which they are:
  // a gate that is written for a known corner is written over by the next new one.
  LUMIGRID_RARE bool readCorners(std::uint32_t known_corners, std::uint32_t count, std::uint32_t& vertices,
                                 std::array<std::uint32_t, 2>& c) {
    bool good = true;
    std::uint64_t before = vertices > 0 ? vertices - 1 : 0;
    for (std::uint32_t k = 0; k < count; ++k) {
      const std::uint32_t is_known = known_corners >> k & 1U;
      gates_[vertices] = packEdge(before, before, before);
      const std::uint8_t* const at = escapes_end_ - 2;
      const std::uint32_t known = at[0] | static_cast<std::uint32_t>(at[1]) << 8;
      good = good && (is_known == 0 || known < vertices);
      escapes_end_ -= 2 * is_known;
      c[k] = is_known != 0 ? known : vertices;
      vertices += 1 - is_known;
      before = c[k];
    }
    return good && escape_ <= escapes_end_;
  }

  LUMIGRID_RARE void pushEdge(std::uint64_t a, std::uint64_t b, std::uint64_t opposite) {
    front_[state_.tail++ & mask_] = packEdge(a & 0xFFFF, b & 0xFFFF, opposite);
  }

  LUMIGRID_RARE void addTriangle(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
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
  std::uint64_t* gates_;
  std::uint32_t step_ = 0;
  State state_;
};

}  // namespace

bool readConnectivity(const PatchHeader& header, const ConnectivityInput& in, const ConnectivityOutput& out) {
  return ConnectivityDecoder(header, in, out).decode();
}

#if defined(__x86_64__)
__attribute__((LUMIGRID_AVX2)) bool readConnectivityByAvx2(const PatchHeader& header, const ConnectivityInput& in,
                                                           const ConnectivityOutput& out) {
  return ConnectivityDecoder(header, in, out).decodeByAvx2();
}
#endif

}  // namespace lod::patch::codec
