#pragma once
// Symbol frequencies of a coded qsplat.lgq: the tables in its header, and the range coder that uses them
// (docs/formats/qsplat.md, "The coded form").
//
// The coder is the range variant of asymmetric numeral systems (Duda 2013): it codes as compactly as arithmetic coding
// and decodes a symbol by one table look-up and one product.
#include <array>
#include <cstdint>
#include <vector>

#include "base/bytes.h"

namespace lod::qsplat {

/// A kind of symbol. Each kind has a table for each of its contexts, that is for what is known before the symbol.
struct SymbolKind {
  std::uint32_t first = 0;  ///< its first context among all
  std::uint32_t contexts = 0;
  std::uint32_t symbols = 0;  ///< different symbols in each context
};

/// The kinds, in the order in which their tables are stored.
inline constexpr SymbolKind kGroupKind{0, 9, 8};
inline constexpr SymbolKind kChildrenKind{9, 64, 7};
inline constexpr SymbolKind kConeKind{73, 75, 4};
inline constexpr SymbolKind kFaceKind{148, 20, 6};
inline constexpr SymbolKind kRowKind{168, 33, 52};
inline constexpr SymbolKind kColumnKind{201, 29, 52};
inline constexpr SymbolKind kSizeKind{230, 56, 13};
inline constexpr SymbolKind kSideKind{286, 52, 13};
inline constexpr SymbolKind kDepthKind{338, 104, 13};
inline constexpr SymbolKind kGreenKind{442, 14, 64};  // green, red and blue: only in files with colours
inline constexpr SymbolKind kRedKind{456, 7, 32};
inline constexpr SymbolKind kBlueKind{463, 7, 32};
inline constexpr SymbolKind kLeafConeKind{470, 12, 32};
inline constexpr std::array<SymbolKind, 13> kSymbolKinds{
    kGroupKind, kChildrenKind, kConeKind,  kFaceKind, kRowKind,  kColumnKind,  kSizeKind,
    kSideKind,  kDepthKind,    kGreenKind, kRedKind,  kBlueKind, kLeafConeKind};
inline constexpr std::uint32_t kContexts = kLeafConeKind.first + kLeafConeKind.contexts;
inline constexpr std::uint32_t kMaxSymbols = 64;

/// The frequencies of a context's symbols add up to kFrequencySum.
inline constexpr std::uint32_t kFrequencyBits = 10;
inline constexpr std::uint32_t kFrequencySum = 1U << kFrequencyBits;
/// Tables store frequencies as levels in half-octaves: 0 for a symbol that never occurs, otherwise 1 … 21.
inline constexpr std::uint32_t kMaxLevel = 21;

/// One level for each symbol of each context.
using SymbolLevels = std::array<std::array<std::uint8_t, kMaxSymbols>, kContexts>;
/// How often each symbol of each context occurs.
using SymbolCounts = std::array<std::array<std::uint64_t, kMaxSymbols>, kContexts>;

/// Computes the levels that are nearest to the counts.
void levelsFrom(const SymbolCounts& counts, SymbolLevels& levels);
/// Makes packLevels take at most `max_bytes`, which is at least 2048: the symbols of the rarest contexts all get level
/// 1, in as many contexts as needed. No file that we measured needed it.
void flattenRarest(const SymbolCounts& counts, bool colors, std::size_t max_bytes, SymbolLevels& levels);
base::Bytes packLevels(const SymbolLevels& levels, bool colors);
/// False when `bytes` are not the output of packLevels.
bool unpackLevels(base::ByteView bytes, bool colors, SymbolLevels& levels);

/// Frequencies as ranges of 0 … kFrequencySum − 1, small enough for the first-level cache. In a context whose levels
/// are all 0, symbol 0 has the whole range.
class CodeTables {
 public:
  explicit CodeTables(const SymbolLevels& levels);

  struct Range {
    std::uint32_t symbol = 0;
    std::uint32_t begin = 0, frequency = 0;
  };
  /// `symbol`: below the number of symbols of the context's kind.
  Range range(std::uint32_t context, std::uint32_t symbol) const {
    const std::uint16_t* begins = &begins_[first_[context] + symbol];
    return {symbol, begins[0], static_cast<std::uint32_t>(begins[1] - begins[0])};
  }
  /// Returns the range that contains `at`.
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

  std::vector<std::uint16_t> begins_;           ///< for each context the begins of its ranges, and kFrequencySum
  std::array<std::uint16_t, kContexts> first_;  ///< index of a context's first range in begins_
  std::vector<std::uint8_t> starts_;            ///< for each 32nd of a context's range its first symbol
};

/// The coder's state stays within kMinState … 2^32 − 1; whole 16-bit words are read and written.
inline constexpr std::uint32_t kMinState = 1U << 16;

/// Decodes symbols. Beyond the end of its bytes it reads zeros, and endedWell() is false.
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
  /// Whether exactly all bytes were used, and the state is the one that a writer starts with.
  bool endedWell() const { return in_.atEnd() && state_ == kMinState; }

 private:
  const CodeTables& tables_;
  base::ByteReader in_;
  std::uint32_t state_;
};

/// Encodes symbols for a SymbolReader. They are collected first, since they are coded from the last to the first.
class SymbolWriter {
 public:
  struct Symbol {
    std::uint16_t context = 0;
    std::uint8_t symbol = 0;
  };
  /// Appends the coded symbols to `out`. False, with nothing appended, if a symbol has no frequency in the tables.
  static bool append(const CodeTables& tables, const std::vector<Symbol>& symbols, base::Bytes& out);
};

}  // namespace lod::qsplat
