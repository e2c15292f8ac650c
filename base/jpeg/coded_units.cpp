#include "base/jpeg/coded_units.h"

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <limits>

#include "base/check.h"
#include "base/crc32c.h"

namespace base::jpeg {
namespace {

constexpr unsigned kCoefficients = 64;

// A unit that goes on behind the end of the data is noticed when it has been read. It has at most 6 blocks of 64
// symbols of at most 27 bits.
constexpr std::size_t kMargin = CodedUnits::kMaxBlocks * kCoefficients * 27 / 8 + 16;

// Reads a difference of means. Nothing where there is no such code. This and the next function take most of the time
// of reading a JPEG; in line, the reader stays in registers between them.
[[gnu::always_inline]] inline std::optional<int> readDifference(BitReader& in, const HuffmanTable& table) {
  in.refill();
  const HuffmanTable::Symbol symbol = table.symbolOf(in.peek(16));
  if (symbol.length == 0 || symbol.value > 11) return std::nullopt;
  const int difference = in.valueBehind(symbol.length, symbol.value);
  in.drop(symbol.length + symbol.value);
  return difference;
}

// Passes over a block's coefficients from number k on, by default all but its mean. Returns whether they are whole.
[[gnu::always_inline]] inline bool skipOthers(BitReader& in, const HuffmanTable& table, unsigned k = 1) {
  while (k < kCoefficients) {
    in.refill();
    const Skip skip = table.skipOf(in.peek(HuffmanTable::kWindow));
    if (skip.bits != 0 && k + skip.steps <= kCoefficients) {
      in.drop(skip.bits);
      if (skip.ends != 0) break;
      k += skip.steps;
      continue;
    }
    const HuffmanTable::Symbol symbol = table.symbolOf(in.peek(16));
    if (symbol.length == 0) return false;
    in.drop(symbol.length + (symbol.value & 15U));
    if (symbol.value == 0) break;
    k += (symbol.value >> 4) + 1U;
    if (k > kCoefficients) return false;
  }
  return true;
}

void readOthers(BitReader& in, const HuffmanTable& table, Block& block) {
  for (unsigned k = 1; k < kCoefficients; ++k) {
    in.refill();
    const HuffmanTable::Symbol symbol = table.symbolOf(in.peek(16));
    const unsigned size = symbol.value & 15U;
    const int value = in.valueBehind(symbol.length, size);
    in.drop(symbol.length + size);
    if (symbol.value == 0) return;
    k += symbol.value >> 4;
    if (size != 0 && k < kCoefficients) block[kZigzag[k]] = static_cast<std::int16_t>(value);
  }
}

// Brightness is read up to coefficients of frequencies (u, v) with u + v = 5. What higher ones add to means over
// squares of 4 x 4 pixels is at most a fortieth of themselves, and they take half of the time.
constexpr unsigned kFrequencies = 21;

// Sums up what the coefficients of a block below number kEnd, and maybe the next, add to its means over squares of
// 4 x 4 pixels. Returns whether all are whole.
template <std::size_t kVectors, unsigned kEnd>
[[gnu::always_inline]] inline bool readMeans(BitReader& in, const HuffmanTable& table, const QuarterWeights& weights,
                                             int mean, std::array<Float4, QuarterWeights::kMost / 4>& means) {
  const Float4* const all = weights.all();
  std::array<Float4, kVectors> sums{};
  const auto add = [&](unsigned k, int value) {
    const auto factor = static_cast<float>(value);
    for (std::size_t i = 0; i < kVectors; ++i) sums[i] += factor * all[kVectors * k + i];
  };
  add(0, mean);
  unsigned k = 1;
  for (; k < kEnd; ++k) {
    in.refill();
    const HuffmanTable::Symbol symbol = table.symbolOf(in.peek(16));
    if (symbol.length == 0) return false;
    const unsigned size = symbol.value & 15U;
    const int value = in.valueBehind(symbol.length, size);
    in.drop(symbol.length + size);
    if (symbol.value == 0) {
      k = kCoefficients;
      break;
    }
    k += symbol.value >> 4;
    if (k >= kCoefficients) return false;
    add(k, value);
  }
  std::copy(sums.begin(), sums.end(), means.begin());
  return skipOthers(in, table, k);
}

// The bits of a value and how many they are (T.81, F.1.2.1).
struct Value {
  std::uint32_t bits = 0;
  unsigned size = 0;
};
Value valueOf(int number) {
  const auto size = static_cast<unsigned>(std::bit_width(static_cast<unsigned>(std::abs(number))));
  const int bits = number < 0 ? number + (1 << size) - 1 : number;
  return {static_cast<std::uint32_t>(bits), size};
}

}  // namespace

std::optional<CodedUnits> CodedUnits::begin(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes) {
  CodedUnits units(layout);
  const std::size_t count = layout.across * layout.down, blocks = layout.blocks();
  LUMIGRID_CHECK(count > 0 && !layout.planes.empty() && blocks <= kMaxBlocks);
  // A block has at least two bits.
  if (coded.size() > std::numeric_limits<std::uint32_t>::max() / 8 || count * blocks > coded.size() * 4 ||
      coded.size() + kMargin + count * (sizeof(std::uint32_t) + blocks * sizeof(std::int16_t)) > max_bytes)
    return std::nullopt;
  units.bytes_ = std::make_unique_for_overwrite<std::uint8_t[]>(coded.size() + kMargin);
  const auto end = unstuff(coded, units.bytes_.get(), units.coded_);
  constexpr std::uint8_t kEndOfImage = 0xD9;
  if (!end || coded[*end + 1] != kEndOfImage) return std::nullopt;
  std::fill_n(units.bytes_.get() + units.coded_, kMargin, std::uint8_t{0});
  units.starts_.reserve(count + 1);
  units.means_.reserve(count * blocks);
  return units;
}

std::optional<CodedUnits> CodedUnits::read(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes,
                                           ByteView index) {
  auto units = begin(layout, coded, max_bytes);
  if (!units || units->takeIndex(index) || units->findUnits()) return units;
  return std::nullopt;
}

std::optional<CodedUnits> CodedUnits::readQuarter(const UnitLayout& layout, ByteView coded, std::uint64_t max_bytes,
                                                  const QuarterRows& quarter) {
  auto units = begin(layout, coded, max_bytes);
  if (!units || units->findQuarter(quarter)) return units;
  return std::nullopt;
}

Bytes CodedUnits::index() const {
  ByteWriter out;
  out.u32(crc32c(ByteView(bytes_.get(), coded_)));
  for (std::size_t unit = 0; unit + 1 < starts_.size(); ++unit)
    out.u16(static_cast<std::uint16_t>(starts_[unit + 1] - starts_[unit]));
  for (const std::int16_t mean : means_) out.u16(static_cast<std::uint16_t>(mean));
  return out.takeBytes();
}

bool CodedUnits::takeIndex(ByteView index) {
  const std::size_t count = layout_.across * layout_.down, means = count * layout_.blocks();
  if (index.size() != sizeof(std::uint32_t) + sizeof(std::uint16_t) * (count + means)) return false;
  ByteReader in(index);
  if (in.u32() != crc32c(ByteView(bytes_.get(), coded_))) return false;
  std::uint64_t at = 0;
  starts_.push_back(0);
  for (std::size_t unit = 0; unit < count; ++unit) starts_.push_back(static_cast<std::uint32_t>(at += in.u16()));
  for (std::size_t i = 0; i < means; ++i) means_.push_back(static_cast<std::int16_t>(in.u16()));
  if (at <= std::uint64_t{8} * coded_) return true;
  starts_.clear(), means_.clear();
  return false;
}

// Goes through all units. others(in, code, plane, unit, block, mean) reads a block's coefficients but its mean, and
// returns whether they are whole.
template <class Others>
bool CodedUnits::walk(const Others& others) {
  const std::size_t count = layout_.across * layout_.down, blocks = layout_.blocks();
  const std::uint64_t bits = std::uint64_t{8} * coded_;
  std::array<int, 3> mean{};
  BitReader in(bytes_.get(), 0);
  for (std::size_t unit = 0; unit < count; ++unit) {
    starts_.push_back(static_cast<std::uint32_t>(in.position()));
    for (std::size_t block = 0; block < blocks; ++block) {
      const std::size_t plane = planeOf(block);
      const auto difference = readDifference(in, *layout_.planes[plane].means);
      if (!difference) return false;
      mean[plane] += *difference;
      if (mean[plane] < -1024 || mean[plane] > 1023) return false;
      means_.push_back(static_cast<std::int16_t>(mean[plane]));
      if (!others(in, *layout_.planes[plane].others, plane, unit, block, mean[plane])) return false;
    }
    if (in.position() > bits) return false;
  }
  starts_.push_back(static_cast<std::uint32_t>(in.position()));
  return bits - in.position() < 8;  // more would be data that belongs nowhere
}

bool CodedUnits::findUnits() {
  return walk([](BitReader& in, const HuffmanTable& table, std::size_t, std::size_t, std::size_t, int) {
    return skipOthers(in, table);
  });
}

bool CodedUnits::findQuarter(const QuarterRows& quarter) {
  QuarterRow row;
  row.across = 2 * quarter.blocks_across, row.down = 2 * quarter.blocks_down;
  row.wide = row.across * layout_.across;
  for (std::size_t plane = 0; plane < layout_.planes.size(); ++plane) row.planes[plane].resize(row.wide * row.down);
  return walk(
      [&](BitReader& in, const HuffmanTable& table, std::size_t plane, std::size_t unit, std::size_t block, int mean) {
        const QuarterWeights& weights = quarter.weights[plane];
        const std::size_t column = unit % layout_.across;
        float* const to = row.planes[plane].data() + row.across * column;
        std::array<Float4, QuarterWeights::kMost / 4> means;
        bool whole = false;
        if (plane == 0)
          whole = readMeans<1, kFrequencies>(in, table, weights, mean, means);
        else if (weights.count() == 16)
          whole = readMeans<4, kCoefficients>(in, table, weights, mean, means);
        else if (weights.count() == 8)
          whole = readMeans<2, kCoefficients>(in, table, weights, mean, means);
        else
          whole = readMeans<1, kCoefficients>(in, table, weights, mean, means);
        if (!whole) return false;
        if (plane == 0) {
          const std::size_t x = 2 * (block % quarter.blocks_across), y = 2 * (block / quarter.blocks_across);
          for (std::size_t i = 0; i < 4; ++i) to[(y + i / 2) * row.wide + x + i % 2] = means[0][i];
        } else {
          for (std::size_t i = 0; i < weights.count(); ++i)
            to[i / row.across * row.wide + i % row.across] = means[i / 4][i % 4];
        }
        if (column + 1 == layout_.across && block + 1 == layout_.blocks()) quarter.take(unit / layout_.across, row);
        return true;
      });
}

void CodedUnits::decode(std::size_t unit, std::span<Block* const> blocks) const {
  BitReader in(bytes_.get(), starts_[unit]);
  for (std::size_t block = 0; block < blocks.size(); ++block) {
    const PlaneCode& code = layout_.planes[planeOf(block)];
    (void)readDifference(in, *code.means);
    if (blocks[block] == nullptr) {
      (void)skipOthers(in, *code.others);
      continue;
    }
    blocks[block]->fill(0);
    (*blocks[block])[0] = mean(unit, block);
    readOthers(in, *code.others, *blocks[block]);
  }
}

// Writes units one after the other. Those that follow each other in the source are copied as one run of bits, of which
// only the means that their differences begin with have other codes.
class CodedUnits::Encoder {
 public:
  explicit Encoder(const CodedUnits& units) : units_(units) {}

  void copy(std::size_t unit) {
    if (first_ < end_ && unit == end_) {
      ++end_;
      return;
    }
    copyRun();
    first_ = unit, end_ = unit + 1;
  }
  void make(const Block* blocks) {
    copyRun();
    for (std::size_t block = 0; block < units_.layout_.blocks(); ++block) {
      const std::size_t plane = units_.planeOf(block);
      putMean(plane, blocks[block][0]);
      putOthers(*units_.layout_.planes[plane].others, blocks[block]);
    }
  }
  void finish(Bytes& out) {
    copyRun();
    out_.finish(out);
  }

 private:
  void copyRun() {
    if (first_ == end_) return;
    const std::uint8_t* const bytes = units_.bytes_.get();
    const std::size_t blocks = units_.layout_.blocks(), first_blocks = units_.layout_.first_blocks;
    BitReader in(bytes, units_.starts_[first_]);
    for (std::size_t block = 0; block < blocks; ++block) {
      const std::size_t plane = units_.planeOf(block);
      const PlaneCode& code = units_.layout_.planes[plane];
      std::uint64_t from = in.position();
      (void)readDifference(in, *code.means);
      if (block == 0 || block >= first_blocks) {
        putMean(plane, units_.mean(first_, block));
        from = in.position();
      }
      (void)skipOthers(in, *code.others);
      out_.copy(bytes, from, in.position());
    }
    out_.copy(bytes, units_.starts_[first_ + 1], units_.starts_[end_]);
    for (std::size_t block = first_blocks - 1; block < blocks; ++block)
      before_[units_.planeOf(block)] = units_.mean(end_ - 1, block);
    first_ = end_ = 0;
  }

  void putMean(std::size_t plane, int mean) {
    const Value value = valueOf(mean - before_[plane]);
    putSymbol(*units_.layout_.planes[plane].means, value.size, value);
    before_[plane] = mean;
  }
  void putOthers(const HuffmanTable& table, const Block& block) {
    constexpr unsigned kSixteenZeros = 0xF0, kEnd = 0;
    unsigned zeros = 0;
    const bool even = std::all_of(block.begin() + 1, block.end(), [](std::int16_t number) { return number == 0; });
    for (unsigned k = even ? kCoefficients : 1; k < kCoefficients; ++k) {
      const int number = block[kZigzag[k]];
      if (number == 0) {
        ++zeros;
        continue;
      }
      for (; zeros > 15; zeros -= 16) putSymbol(table, kSixteenZeros, {});
      const Value value = valueOf(number);
      putSymbol(table, (zeros << 4) | value.size, value);
      zeros = 0;
    }
    if (even || zeros > 0) putSymbol(table, kEnd, {});
  }
  void putSymbol(const HuffmanTable& table, unsigned symbol, const Value& value) {
    const HuffmanTable::Code code = table.codeOf(static_cast<std::uint8_t>(symbol));
    LUMIGRID_CHECK(value.size <= 11 && code.length != 0);
    out_.put(code.bits, code.length);
    out_.put(value.bits, value.size);
  }

  const CodedUnits& units_;
  BitWriter out_;
  std::array<int, 3> before_{};      // the planes' last means
  std::size_t first_ = 0, end_ = 0;  // units of the source that are not copied yet
};

void CodedUnits::encode(std::size_t count, const Source& source, Bytes& out) const {
  std::array<Block, kMaxBlocks> blocks;
  Encoder encoder(*this);
  for (std::size_t i = 0; i < count; ++i) {
    if (const auto unit = source(i, blocks.data()))
      encoder.copy(*unit);
    else
      encoder.make(blocks.data());
  }
  encoder.finish(out);
}

}  // namespace base::jpeg
