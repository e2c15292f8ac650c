#pragma once
// Bounded little-endian reading and writing. A reader never goes past its end: it turns bad instead and yields zeros,
// so a decoder may read a whole header and ask ok() once.
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace base {

static_assert(std::endian::native == std::endian::little, "Lumigrid's formats are little-endian; this machine is not");

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

/// std::bit_cast, which the browser's standard library does not have yet.
template <class To, class From>
constexpr To bitCast(const From& from) {
  static_assert(sizeof(To) == sizeof(From) && std::is_trivially_copyable_v<To> && std::is_trivially_copyable_v<From>);
  return __builtin_bit_cast(To, from);
}

/// Two lower-case hexadecimal digits a byte.
inline std::string hexOf(ByteView bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
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

  /// The next `count` bytes, or an empty view (and a bad reader) when fewer are left.
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
  Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

}  // namespace base
