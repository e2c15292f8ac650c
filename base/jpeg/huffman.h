#pragma once
// Huffman codes of baseline JPEGs (ITU-T T.81, annexes C and F) and the bits they are read from and written to. Private
// to base/jpeg.
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>

#include "base/bytes.h"

namespace base::jpeg {

/// Whole symbols at the beginning of some bits, told in 16 bits so that tables stay in the nearest cache.
struct Skip {
  std::uint16_t bits : 5;   ///< of whole symbols and their values; 0 where the code is longer than the table's window
  std::uint16_t steps : 7;  ///< by which they go on among a block's coefficients, an end of block counted as 1
  std::uint16_t ends : 1;   ///< whether the last of them is the end of the block
};

/// The code of one table.
class HuffmanTable {
 public:
  /// A code of at most so many bits is found by one look-up.
  static constexpr unsigned kWindow = 13;
  struct Symbol {
    std::uint8_t value = 0;
    std::uint8_t length = 0;  ///< of the code, bits; 0: there is none
  };
  struct Code {
    std::uint16_t bits = 0;
    std::uint8_t length = 0;
  };

  /// `lengths[n]`: how many codes have n bits, 1 to 16; `symbols`: their meanings in this order. Nothing where this is
  /// no prefix code, or has a symbol twice.
  static std::optional<HuffmanTable> make(std::span<const std::uint8_t, 17> lengths,
                                          std::span<const std::uint8_t, 256> symbols);

  /// The symbol with which 16 bits begin.
  Symbol symbolOf(std::uint32_t bits) const {
    const Symbol found = short_[bits >> (16 - kWindow)];
    return found.length != 0 ? found : longSymbolOf(bits);
  }
  /// The code of a symbol; its length is 0 where it has none.
  Code codeOf(std::uint8_t symbol) const { return codes_[symbol]; }
  /// As many whole symbols of coefficients as `kWindow` bits hold, at least one, whose value may reach beyond them.
  Skip skipOf(std::uint32_t window) const { return several_[window]; }

 private:
  Symbol longSymbolOf(std::uint32_t bits) const;

  std::array<Symbol, 1U << kWindow> short_{};
  std::array<Skip, 1U << kWindow> several_{};
  std::array<std::uint32_t, 17> end_{};    // the first bits, of 16, behind the codes of each length
  std::array<std::uint16_t, 17> first_{};  // of symbols_, less the first code of this length
  std::array<std::uint8_t, 256> symbols_{};
  std::array<Code, 256> codes_{};
};

/// A value of `bits` bits, at most 15 (T.81, F.2.2.1); 0 for none.
inline int extended(std::uint32_t value, unsigned bits) {
  const auto number = static_cast<int>(value);
  const int below = (1 << bits) - 1;
  return 2 * number > below ? number : number - below;
}

/// Reads bits from the highest on, without bytes that are stuffed in. Up to 8 bytes are read beyond the bits asked for.
class BitReader {
 public:
  BitReader(const std::uint8_t* data, std::uint64_t bit) : data_(data), next_(data + bit / 8) {
    refill();
    drop(static_cast<unsigned>(bit % 8));
  }
  /// Afterwards 56 bits can be seen and dropped.
  void refill() {
    hold_ |= wordAt(next_) >> left_;
    next_ += (63 - left_) >> 3;
    left_ |= 56;
  }
  /// 1 to 32 bits.
  std::uint32_t peek(unsigned bits) const { return static_cast<std::uint32_t>(hold_ >> (64 - bits)); }
  void drop(unsigned bits) { hold_ <<= bits, left_ -= bits; }
  /// The value of `size` bits, at most 15, behind the next `bits`.
  int valueBehind(unsigned bits, unsigned size) const {
    return extended(static_cast<std::uint32_t>(hold_ << bits >> 1 >> (63 - size)), size);
  }
  /// In bits.
  std::uint64_t position() const { return static_cast<std::uint64_t>(next_ - data_) * 8 - left_; }

  /// The 8 bytes at a place, the first of them highest.
  static std::uint64_t wordAt(const std::uint8_t* bytes) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes, sizeof(word));
    static_assert(std::endian::native == std::endian::little);
    return __builtin_bswap64(word);
  }

 private:
  const std::uint8_t* data_;
  const std::uint8_t* next_;
  std::uint64_t hold_ = 0;  // from the highest bit on
  unsigned left_ = 0;       // bits in hold_ that count
};

/// Collects bits, the first of them highest.
class BitWriter {
 public:
  /// 0 to 32 bits; higher ones of `value` are 0.
  void put(std::uint32_t value, unsigned bits) {
    hold_ = (hold_ << bits) | value;
    count_ += bits;
    if (count_ < 32) return;
    count_ -= 32;
    const std::uint32_t word = __builtin_bswap32(static_cast<std::uint32_t>(hold_ >> count_));
    if (bytes_.size() < used_ + sizeof(word)) bytes_.resize(2 * bytes_.size() + 4096);
    std::memcpy(&bytes_[used_], &word, sizeof(word));
    used_ += sizeof(word);
  }
  /// Copies bits [from, to) of `data`, of which 8 bytes more can be read.
  void copy(const std::uint8_t* data, std::uint64_t from, std::uint64_t to);
  /// Appends all bits to a JPEG, with ones up to the end of the last byte, and a 0 after each byte of ones.
  void finish(Bytes& out);

 private:
  Bytes bytes_;
  std::size_t used_ = 0;
  std::uint64_t hold_ = 0;
  unsigned count_ = 0;  // bits of hold_ that are not in bytes_, below 32
};

/// Copies the bytes of coded data up to the next marker, without the 0 after each byte of ones. Returns where the
/// marker begins; nothing where there is none.
std::optional<std::size_t> unstuff(ByteView coded, std::uint8_t* out, std::size_t& written);

}  // namespace base::jpeg
