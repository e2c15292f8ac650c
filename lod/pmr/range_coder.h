#pragma once
// An adaptive binary range coder, and numbers on it: the lengths and bits of Elias's gamma code with learnt
// probabilities. All arithmetic is in integers, so every reader computes the same probabilities (docs/formats/pmr.md,
// "Range coder").
//
// RangeEncoder and RangeDecoder have the same functions. The encoder returns the value that it is given; the decoder
// ignores that value and returns the one it reads. So one template codes in both directions.
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <utility>

#include "base/bytes.h"

namespace lod::pmr {

/// The probability that a bit is 0, in 65536ths. It follows the bits seen: fast at first, then slowly.
class BitModel {
 public:
  std::uint32_t zero() const { return zero_; }
  /// Without branches: a bit that is worth coding is one that a processor does not foresee.
  void adapt(std::uint32_t bit) {
    const std::uint32_t shift = kShifts[seen_];
    const std::uint32_t rise = (65536U - zero_) >> shift;
    const std::uint32_t fall = 0U - (std::uint32_t{zero_} >> shift);
    const std::uint32_t ones = 0U - bit;
    zero_ = static_cast<std::uint16_t>(zero_ + ((rise & ~ones) | (fall & ones)));
    seen_ = static_cast<std::uint16_t>(seen_ + (seen_ + 1U < kShifts.size() ? 1U : 0U));
  }

 private:
  // The n-th bit moves the probability by a part of 2^−shift: about the mean of n bits.
  static constexpr std::array<std::uint8_t, 32> kShifts{1, 2, 2, 2, 3, 3, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4,
                                                        4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 5, 5, 6};
  std::uint16_t zero_ = 32768;
  std::uint16_t seen_ = 0;
};

inline constexpr std::uint32_t kMinRange = 1U << 24;
/// The most bits of one raw() call.
inline constexpr unsigned kMaxRawBits = 16;

class RangeEncoder {
 public:
  std::uint32_t bit(BitModel& model, std::uint32_t bit) {
    const std::uint32_t bound = (range_ >> 16) * model.zero();
    if (bit == 0) {
      range_ = bound;
    } else {
      add(bound);
      range_ -= bound;
    }
    model.adapt(bit);
    normalize();
    return bit;
  }

  /// Codes `count` bits, at most kMaxRawBits, that are 0 and 1 equally often.
  std::uint32_t raw(unsigned count, std::uint32_t value) {
    range_ >>= count;
    add(value * range_);
    normalize();
    return value;
  }

  /// Returns the bytes, without zeros at the end: a decoder reads zeros behind them.
  base::Bytes finish() {
    // One number within the range is enough: the one with the most zero bytes at its end.
    for (unsigned zeros = 24;; zeros -= 8) {
      const std::uint64_t mask = (std::uint64_t{1} << zeros) - 1;
      const std::uint64_t rounded = (low_ + mask) & ~mask;
      if (rounded >= std::uint64_t{low_} + range_) continue;
      add(static_cast<std::uint32_t>(rounded - low_));
      break;
    }
    for (int i = 0; i < 4; ++i) shiftOut();
    while (!bytes_.empty() && bytes_.back() == 0) bytes_.pop_back();
    return std::move(bytes_);
  }

 private:
  void add(std::uint32_t value) {
    low_ += value;
    if (low_ >= value) return;
    // The sum overflowed: the carry goes through the bytes that are out already.
    for (std::size_t i = bytes_.size(); i-- > 0 && ++bytes_[i] == 0;) continue;
  }
  void shiftOut() {
    bytes_.push_back(static_cast<std::uint8_t>(low_ >> 24));
    low_ <<= 8;
  }
  void normalize() {
    while (range_ < kMinRange) {
      shiftOut();
      range_ <<= 8;
    }
  }

  base::Bytes bytes_;
  std::uint32_t low_ = 0;
  std::uint32_t range_ = 0xFFFFFFFF;
};

/// Any bytes decode to something. The caller bounds how much it reads.
class RangeDecoder {
 public:
  explicit RangeDecoder(base::ByteView bytes) : at_(bytes.data()), end_(bytes.data() + bytes.size()) {
    for (int i = 0; i < 4; ++i) code_ = code_ << 8 | next();
  }

  std::uint32_t bit(BitModel& model, std::uint32_t = 0) {
    const std::uint32_t bound = (range_ >> 16) * model.zero();
    const std::uint32_t bit = code_ < bound ? 0 : 1;
    const std::uint32_t ones = 0U - bit;
    code_ -= bound & ones;
    range_ = (bound & ~ones) | ((range_ - bound) & ones);
    model.adapt(bit);
    normalize();
    return bit;
  }

  std::uint32_t raw(unsigned count, std::uint32_t = 0) {
    range_ >>= count;
    const std::uint32_t value = std::min(code_ / range_, (1U << count) - 1);
    code_ -= value * range_;
    normalize();
    return value;
  }

 private:
  std::uint32_t next() { return at_ != end_ ? *at_++ : 0U; }
  void normalize() {
    while (range_ < kMinRange) {
      range_ <<= 8;
      code_ = code_ << 8 | next();
    }
  }

  const std::uint8_t* at_;
  const std::uint8_t* end_;
  std::uint32_t code_ = 0;
  std::uint32_t range_ = 0xFFFFFFFF;
};

/// A symbol of kBits bits, from its top bit on; each bit's probability depends on those before it.
template <unsigned kBits>
class SymbolModel {
 public:
  template <class Coder>
  std::uint32_t code(Coder& coder, std::uint32_t symbol) {
    std::uint32_t node = 1;
    for (unsigned i = kBits; i-- > 0;) node = node << 1 | coder.bit(bits_[node], symbol >> i & 1);
    return node - (1U << kBits);
  }

 private:
  std::array<BitModel, 1U << kBits> bits_;
};

/// Codes the low `count` bits of a number, at most 64, as they are.
template <class Coder>
std::uint64_t codeRaw(Coder& coder, unsigned count, std::uint64_t value) {
  std::uint64_t coded = 0;
  while (count > 0) {
    const unsigned now = std::min(count, kMaxRawBits);
    count -= now;
    coded = coded << now | coder.raw(now, static_cast<std::uint32_t>(value >> count) & ((1U << now) - 1));
  }
  return coded;
}

/// A number below 2^(2^kLengthBits − 1): its length in bits as a symbol, the bit behind its first one with a learnt
/// probability, the others as they are.
template <unsigned kLengthBits>
class BasicNumberModel {
 public:
  template <class Coder>
  std::uint64_t code(Coder& coder, std::uint64_t value) {
    const std::uint32_t length = length_.code(coder, static_cast<std::uint32_t>(std::bit_width(value)));
    if (length < 2) return length;
    const unsigned left = length - 2;
    const std::uint64_t top = 2 | coder.bit(second_[length], static_cast<std::uint32_t>(value >> left) & 1);
    return left == 0 ? top : top << left | codeRaw(coder, left, value & ((std::uint64_t{1} << left) - 1));
  }

 private:
  SymbolModel<kLengthBits> length_;
  std::array<BitModel, 1U << kLengthBits> second_;
};
using NumberModel = BasicNumberModel<5>;
/// Up to 2^63 − 1.
using LongNumberModel = BasicNumberModel<6>;

/// A number of either sign, of less than 31 bits: its magnitude, then its sign unless it is 0.
class SignedModel {
 public:
  template <class Coder>
  std::int32_t code(Coder& coder, std::int32_t value) {
    const auto magnitude =
        static_cast<std::int32_t>(magnitude_.code(coder, static_cast<std::uint32_t>(value < 0 ? -value : value)));
    if (magnitude == 0) return 0;
    return coder.bit(sign_, value < 0 ? 1 : 0) != 0 ? -magnitude : magnitude;
  }

 private:
  NumberModel magnitude_;
  BitModel sign_;
};

}  // namespace lod::pmr
