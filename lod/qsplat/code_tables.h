#pragma once
// How often which symbol stands where in a coded qsplat.lgq: the tables that its header carries, and the range coder
// that goes by them (docs/formats/qsplat.md, "The coded form").
//
// The coder is Duda's range variant of asymmetric numeral systems (2013): as short as arithmetic coding, and a symbol
// is decoded by a table look-up and a product.
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/bytes.h"

namespace lod::qsplat {

/// What a symbol tells of. Each kind has tables of its own, one for each context: what is known before.
struct SymbolKind {
  std::uint32_t first = 0;  ///< of its contexts among all
  std::uint32_t contexts = 0;
  std::uint32_t symbols = 0;  ///< in each
};

/// In the order in which their tables are stored.
inline constexpr SymbolKind kGroupKind{0, 9, 8};
inline constexpr SymbolKind kChildrenKind{9, 64, 7};
inline constexpr SymbolKind kConeKind{73, 75, 4};
inline constexpr SymbolKind kFaceKind{148, 20, 6};
inline constexpr SymbolKind kRowKind{168, 33, 52};
inline constexpr SymbolKind kColumnKind{201, 29, 52};
inline constexpr SymbolKind kSizeKind{230, 56, 13};
inline constexpr SymbolKind kSideKind{286, 52, 13};
inline constexpr SymbolKind kDepthKind{338, 104, 13};
inline constexpr SymbolKind kGreenKind{442, 14, 64};  // these three in files with colours
inline constexpr SymbolKind kRedKind{456, 7, 32};
inline constexpr SymbolKind kBlueKind{463, 7, 32};
inline constexpr SymbolKind kLeafConeKind{470, 12, 32};
inline constexpr std::array<SymbolKind, 13> kSymbolKinds{
    kGroupKind, kChildrenKind, kConeKind,  kFaceKind, kRowKind,  kColumnKind,  kSizeKind,
    kSideKind,  kDepthKind,    kGreenKind, kRedKind,  kBlueKind, kLeafConeKind};
inline constexpr std::uint32_t kContexts = kLeafConeKind.first + kLeafConeKind.contexts;
inline constexpr std::uint32_t kMaxSymbols = 64;

/// Frequencies of a context's symbols add up to this.
inline constexpr std::uint32_t kFrequencyBits = 10;
inline constexpr std::uint32_t kFrequencySum = 1U << kFrequencyBits;
/// Frequencies are kept as half-octaves: 0 for a symbol that never comes, else 1 … 21.
inline constexpr std::uint32_t kMaxLevel = 21;

/// One level for each symbol of each context.
using SymbolLevels = std::array<std::array<std::uint8_t, kMaxSymbols>, kContexts>;
/// How often each came.
using SymbolCounts = std::array<std::array<std::uint64_t, kMaxSymbols>, kContexts>;

/// The nearest levels.
void levelsFrom(const SymbolCounts& counts, SymbolLevels& levels);
/// So that packLevels takes no more than `most_bytes`, at least 2048: the rarest contexts' symbols all get level 1, as
/// many of them as it needs. No file that was seen needed it.
void flattenRarest(const SymbolCounts& counts, bool colors, std::size_t most_bytes, SymbolLevels& levels);
base::Bytes packLevels(const SymbolLevels& levels, bool colors);
/// False when `bytes` are not what packLevels wrote.
bool unpackLevels(base::ByteView bytes, bool colors, SymbolLevels& levels);

/// Frequencies as ranges of 0 … kFrequencySum − 1, in as little memory as the fastest cache has. A context whose levels
/// are all 0 has symbol 0 alone.
class CodeTables {
 public:
  explicit CodeTables(const SymbolLevels& levels);

  struct Range {
    std::uint32_t symbol = 0;
    std::uint32_t begin = 0, frequency = 0;
  };
  /// symbol: one that the context's kind has.
  Range range(std::uint32_t context, std::uint32_t symbol) const {
    const std::uint16_t* begins = &begins_[first_[context] + symbol];
    return {symbol, begins[0], static_cast<std::uint32_t>(begins[1] - begins[0])};
  }
  /// The range that has `at`.
  Range find(std::uint32_t context, std::uint32_t at) const {
    const std::uint16_t* begins = &begins_[first_[context]];
    std::uint32_t symbol = starts_[context * kStarts + (at >> kStartShift)];
    while (begins[symbol + 1] <= at) ++symbol;
    return {symbol, begins[symbol], static_cast<std::uint32_t>(begins[symbol + 1] - begins[symbol])};
  }

 private:
  static constexpr std::uint32_t kStarts = 32;
  static constexpr std::uint32_t kStartShift = kFrequencyBits - 5;
  static_assert(kStarts << kStartShift == kFrequencySum);

  std::vector<std::uint16_t> begins_;           ///< of each context its symbols' ranges, and kFrequencySum
  std::array<std::uint16_t, kContexts> first_;  ///< of a context there
  std::vector<std::uint8_t> starts_;            ///< the first symbol that may have a 32nd of a context's range
};

/// The coder's state stays in kMinState … 2^32 − 1; whole 16-bit words go in and out.
inline constexpr std::uint32_t kMinState = 1U << 16;

/// Takes symbols out of bytes; past their end it yields zeros and ends badly.
class SymbolReader {
 public:
  SymbolReader(const CodeTables& tables, base::ByteView bytes) : tables_(tables), in_(bytes), state_(in_.u32()) {}

  std::uint32_t symbol(std::uint32_t context) {
    const std::uint32_t at = state_ & (kFrequencySum - 1);
    const CodeTables::Range range = tables_.find(context, at);
    state_ = range.frequency * (state_ >> kFrequencyBits) + at - range.begin;
    if (state_ < kMinState) state_ = state_ << 16 | in_.u16();
    return range.symbol;
  }
  /// All bytes were there and taken, and the state is the one that a writer begins with.
  bool endedWell() const { return in_.atEnd() && state_ == kMinState; }

 private:
  const CodeTables& tables_;
  base::ByteReader in_;
  std::uint32_t state_;
};

/// What a SymbolReader takes out again. Symbols are collected first: they are coded from the last to the first.
class SymbolWriter {
 public:
  struct Symbol {
    std::uint16_t context = 0;
    std::uint8_t symbol = 0;
  };
  /// Appends to `out`. Nothing when a symbol never comes, as the tables have it.
  static bool append(const CodeTables& tables, const std::vector<Symbol>& symbols, base::Bytes& out);
};

}  // namespace lod::qsplat
