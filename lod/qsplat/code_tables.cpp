#include "lod/qsplat/code_tables.h"

#include <algorithm>
#include <numeric>

namespace lod::qsplat {
namespace {

// The weights of levels: 16 · 2^(level/2 − 1/2), rounded.
constexpr std::array<std::uint32_t, kMaxLevel + 1> kWeights{
    0, 16, 23, 32, 45, 64, 91, 128, 181, 256, 362, 512, 724, 1024, 1448, 2048, 2896, 4096, 5793, 8192, 11585, 16384};

bool allZero(const std::array<std::uint8_t, kMaxSymbols>& levels) {
  return std::all_of(levels.begin(), levels.end(), [](std::uint8_t level) { return level == 0; });
}

// Writes bits, from the least significant of each byte on.
class BitWriter {
 public:
  void bit(std::uint32_t value) {
    if (used_ == 0) bytes_.push_back(0);
    bytes_.back() = static_cast<std::uint8_t>(bytes_.back() | value << used_);
    used_ = (used_ + 1) % 8;
  }
  /// Writes Elias's gamma code of value + 1: as many zeros as bits follow its highest one, then its bits from the top.
  void gamma(std::uint32_t value) {
    int bits = 0;
    while ((value + 1) >> (bits + 1) != 0) ++bits;
    for (int i = 0; i < bits; ++i) bit(0);
    for (int i = bits; i >= 0; --i) bit((value + 1) >> i & 1U);
  }
  base::Bytes takeBytes() { return std::move(bytes_); }

 private:
  base::Bytes bytes_;
  int used_ = 0;
};

class BitReader {
 public:
  explicit BitReader(base::ByteView bytes) : bytes_(bytes) {}
  std::uint32_t bit() {
    if (at_ / 8 >= bytes_.size()) {
      ok_ = false;
      return 0;
    }
    const std::uint32_t value = bytes_[at_ / 8] >> at_ % 8 & 1U;
    ++at_;
    return value;
  }
  std::uint32_t gamma() {
    int bits = 0;
    while (ok_ && bit() == 0)
      if (++bits > kMaxGammaBits) ok_ = false;
    std::uint32_t value = 1;
    for (int i = 0; ok_ && i < bits; ++i) value = value << 1 | bit();
    return value - 1;
  }
  /// Whether all bytes were read, with only zeros after the last bit.
  bool endedWell() {
    while (ok_ && at_ % 8 != 0)
      if (bit() != 0) ok_ = false;
    return ok_ && at_ / 8 == bytes_.size();
  }
  bool ok() const { return ok_; }

 private:
  static constexpr int kMaxGammaBits = 8;
  base::ByteView bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

bool isColorKind(const SymbolKind& kind) {
  return kind.first >= kGreenKind.first && kind.first < kLeafConeKind.first;
}

/// Calls visit(context, symbols) for each context of a file with or without colours.
template <class Visit>
void forEachContext(bool colors, const Visit& visit) {
  for (const SymbolKind& kind : kSymbolKinds) {
    if (isColorKind(kind) && !colors) continue;
    for (std::uint32_t c = kind.first; c < kind.first + kind.contexts; ++c) visit(c, kind.symbols);
  }
}

/// Computes frequencies in proportion to the weights; each symbol that occurs has at least 1.
void assignFrequencies(const std::array<std::uint8_t, kMaxSymbols>& levels,
                       std::array<std::uint32_t, kMaxSymbols>& frequencies) {
  frequencies.fill(0);
  std::uint32_t sum = 0;
  for (const std::uint8_t level : levels) sum += kWeights[level];
  if (sum == 0) {
    frequencies[0] = kFrequencySum;
    return;
  }
  std::uint32_t given = 0;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    if (levels[i] == 0) continue;
    frequencies[i] = std::max(1U, (2 * kFrequencySum * kWeights[levels[i]] + sum) / (2 * sum));
    given += frequencies[i];
  }
  // Rounding may have left some frequency over or given too much: the most frequent symbols change least by it.
  while (given != kFrequencySum) {
    std::uint32_t& most = *std::max_element(frequencies.begin(), frequencies.end());
    const std::uint32_t step = given < kFrequencySum ? kFrequencySum - given : 1;
    given < kFrequencySum ? most += step : most -= step;
    given < kFrequencySum ? given += step : given -= step;
  }
}

}  // namespace

void levelsFrom(const SymbolCounts& counts, SymbolLevels& levels) {
  for (std::size_t c = 0; c < kContexts; ++c) {
    const std::uint64_t all = std::accumulate(counts[c].begin(), counts[c].end(), std::uint64_t{0});
    for (std::size_t s = 0; s < kMaxSymbols; ++s) {
      levels[c][s] = 0;
      if (counts[c][s] == 0) continue;
      // In units of the weights; two neighbouring levels meet at their geometric mean.
      const double weight = kWeights[kMaxLevel] * (static_cast<double>(counts[c][s]) / static_cast<double>(all));
      std::uint8_t level = 1;
      while (level < kMaxLevel && weight * weight >= 1.0 * kWeights[level] * kWeights[level + 1U]) ++level;
      levels[c][s] = level;
    }
  }
}

void flattenRarest(const SymbolCounts& counts, bool colors, std::size_t max_bytes, SymbolLevels& levels) {
  struct Context {
    std::uint64_t count;
    std::uint32_t number, symbols;
  };
  std::vector<Context> contexts;
  forEachContext(colors, [&](std::uint32_t context, std::uint32_t symbols) {
    const std::uint64_t all = std::accumulate(counts[context].begin(), counts[context].end(), std::uint64_t{0});
    if (all > 0) contexts.push_back({all, context, symbols});
  });
  std::stable_sort(contexts.begin(), contexts.end(),
                   [](const Context& a, const Context& b) { return a.count < b.count; });
  for (const Context& rarest : contexts) {
    if (packLevels(levels, colors).size() <= max_bytes) return;
    std::fill_n(levels[rarest.number].begin(), rarest.symbols, std::uint8_t{1});
  }
}

base::Bytes packLevels(const SymbolLevels& levels, bool colors) {
  BitWriter out;
  forEachContext(colors, [&](std::uint32_t context, std::uint32_t symbols) {
    const bool used = !allZero(levels[context]);
    out.bit(used ? 1 : 0);
    std::uint32_t last = 0;
    for (std::uint32_t s = 0; used && s < symbols; ++s) {
      const std::uint32_t level = levels[context][s];
      out.gamma(level > last ? 2 * (level - last) - 1 : 2 * (last - level));
      last = level;
    }
  });
  return out.takeBytes();
}

bool unpackLevels(base::ByteView bytes, bool colors, SymbolLevels& levels) {
  for (auto& context : levels) context.fill(0);
  BitReader in(bytes);
  bool good = true;
  forEachContext(colors, [&](std::uint32_t context, std::uint32_t symbols) {
    if (in.bit() == 0) return;
    std::uint32_t level = 0;
    for (std::uint32_t s = 0; good && in.ok() && s < symbols; ++s) {
      const std::uint32_t step = in.gamma();
      level = step % 2 != 0 ? level + (step + 1) / 2 : level - step / 2;
      good = level <= kMaxLevel;
      if (good) levels[context][s] = static_cast<std::uint8_t>(level);
    }
  });
  return good && in.endedWell();
}

CodeTables::CodeTables(const SymbolLevels& levels) : starts_(std::size_t{kContexts} * kStarts) {
  std::array<std::uint32_t, kMaxSymbols> frequencies;
  forEachContext(true, [&](std::uint32_t context, std::uint32_t symbols) {
    assignFrequencies(levels[context], frequencies);
    first_[context] = static_cast<std::uint16_t>(begins_.size());
    std::uint32_t end = 0;
    std::uint32_t start = 0;
    for (std::uint32_t s = 0; s < symbols; ++s) {
      begins_.push_back(static_cast<std::uint16_t>(end));
      end += frequencies[s];
      for (; start < kStarts && start << kStartShift < end; ++start)
        starts_[context * kStarts + start] = static_cast<std::uint8_t>(s);
    }
    begins_.push_back(static_cast<std::uint16_t>(end));
  });
}

bool SymbolWriter::append(const CodeTables& tables, const std::vector<Symbol>& symbols, base::Bytes& out) {
  std::vector<std::uint16_t> words;
  std::uint32_t state = kMinState;
  for (auto it = symbols.rbegin(); it != symbols.rend(); ++it) {
    const CodeTables::Range range = tables.range(it->context, it->symbol);
    if (range.frequency == 0) return false;
    const std::uint64_t limit = std::uint64_t{kMinState >> kFrequencyBits << 16} * range.frequency;
    if (state >= limit) {
      words.push_back(static_cast<std::uint16_t>(state));
      state >>= 16;
    }
    state = (state / range.frequency << kFrequencyBits) + state % range.frequency + range.begin;
  }
  base::ByteWriter bytes;
  bytes.u32(state);
  for (auto it = words.rbegin(); it != words.rend(); ++it) bytes.u16(*it);
  out.insert(out.end(), bytes.view().begin(), bytes.view().end());
  return true;
}

}  // namespace lod::qsplat
