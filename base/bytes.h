#pragma once
// Bounded little-endian reading and writing. A reader never reads past its end: it fails instead and returns zeros, so
// a decoder may read a whole header and ask ok() once.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace base {

static_assert(std::endian::native == std::endian::little, "Lumigrid's formats are little-endian; this machine is not");

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

/// Replaces std::bit_cast, which the browser's standard library does not have yet.
template <class To, class From>
constexpr To bitCast(const From& from) {
  static_assert(sizeof(To) == sizeof(From) && std::is_trivially_copyable_v<To> && std::is_trivially_copyable_v<From>);
  return __builtin_bit_cast(To, from);
}

inline ByteView viewOfText(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}
inline std::string_view textOf(ByteView bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Writes two lower-case hexadecimal digits per byte.
inline std::string hexOf(ByteView bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

/// Reads what hexOf() wrote; nullopt for any other text.
inline std::optional<Bytes> bytesOfHex(std::string_view text) {
  const auto digit = [](char c) { return c >= '0' && c <= '9' ? c - '0' : c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1; };
  if (text.size() % 2 != 0) return std::nullopt;
  Bytes bytes;
  bytes.reserve(text.size() / 2);
  for (std::size_t i = 0; i < text.size(); i += 2) {
    const int high = digit(text[i]);
    const int low = digit(text[i + 1]);
    if (high < 0 || low < 0) return std::nullopt;
    bytes.push_back(static_cast<std::uint8_t>(16 * high + low));
  }
  return bytes;
}

class ByteReader {
 public:
  explicit ByteReader(ByteView bytes) : bytes_(bytes) {}

  /// Next value of a trivially copyable type (integers, floats, glm vectors), little-endian as in memory.
  template <class T>
  T read() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    if (need(sizeof(T))) {
      std::memcpy(&value, bytes_.data() + offset_, sizeof(T));
      offset_ += sizeof(T);
    }
    return value;
  }
  std::uint8_t u8() { return read<std::uint8_t>(); }
  std::uint16_t u16() { return read<std::uint16_t>(); }
  std::uint32_t u32() { return read<std::uint32_t>(); }
  std::uint64_t u64() { return read<std::uint64_t>(); }
  float f32() { return read<float>(); }
  double f64() { return read<double>(); }

  /// A number of variable length (LEB128): 7 bits a byte, lowest first; bit 7 is set when more bytes follow. Fails for
  /// a number that does not fit or is longer than necessary, so that each number has one form only.
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const std::uint64_t byte = u8();
      if (!ok_ || (shift == 63 && byte > 1)) break;
      value |= (byte & 0x7F) << shift;
      if ((byte & 0x80) == 0) {
        if (byte == 0 && shift != 0) break;
        return value;
      }
    }
    ok_ = false;
    return 0;
  }
  /// The next `count` bytes; fails, and returns an empty view, when fewer are left.
  ByteView bytes(std::size_t count) {
    if (!need(count)) return {};
    ByteView part = bytes_.subspan(offset_, count);
    offset_ += count;
    return part;
  }
  /// A string with a u16 length before it.
  std::string string16() {
    ByteView part = bytes(u16());
    return {part.begin(), part.end()};
  }

  bool ok() const { return ok_; }
  bool atEnd() const { return ok_ && offset_ == bytes_.size(); }
  std::size_t offset() const { return offset_; }
  std::size_t remaining() const { return bytes_.size() - offset_; }
  void fail() { ok_ = false; }

 private:
  bool need(std::size_t count) {
    if (!ok_ || count > bytes_.size() - offset_) ok_ = false;
    return ok_;
  }
  ByteView bytes_;
  std::size_t offset_ = 0;
  bool ok_ = true;
};

class ByteWriter {
 public:
  template <class T>
  void write(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    const std::size_t offset = bytes_.size();
    bytes_.resize(offset + sizeof(T));
    std::memcpy(bytes_.data() + offset, &value, sizeof(T));
  }
  void u8(std::uint8_t v) { write(v); }
  void u16(std::uint16_t v) { write(v); }
  void u32(std::uint32_t v) { write(v); }
  void u64(std::uint64_t v) { write(v); }
  void f32(float v) { write(v); }
  void f64(double v) { write(v); }
  void varint(std::uint64_t v) {  ///< ByteReader::varint()
    for (; v >= 0x80; v >>= 7) u8(static_cast<std::uint8_t>(v | 0x80));
    u8(static_cast<std::uint8_t>(v));
  }
  void bytes(ByteView v) { bytes_.insert(bytes_.end(), v.begin(), v.end()); }
  /// A string with a u16 length before it; longer than 65535 bytes is cut.
  void string16(std::string_view v) {
    v = v.substr(0, 65535);
    u16(static_cast<std::uint16_t>(v.size()));
    bytes_.insert(bytes_.end(), v.begin(), v.end());
  }
  /// Overwrites bytes already written at `offset`.
  template <class T>
  void patch(std::size_t offset, const T& value) {
    std::memcpy(bytes_.data() + offset, &value, sizeof(T));
  }

  std::size_t size() const { return bytes_.size(); }
  const Bytes& view() const { return bytes_; }
  Bytes takeBytes() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

}  // namespace base
