#pragma once
// A source with one object, whose bytes are computed from their offsets.
#include <string>

#include "repository/objects/objects.h"

namespace repository::test {

class MadeObject final : public ObjectSource {
 public:
  explicit MadeObject(std::uint64_t size) : size_(size) {}
  base::Result<base::Bytes> read(const std::string&, std::uint64_t offset, std::uint64_t length) const override {
    base::Bytes bytes(length);
    for (std::uint64_t i = 0; i < length; ++i) bytes[i] = byteAt(offset + i);
    return bytes;
  }
  base::Result<std::uint64_t> size(const std::string&) const override { return size_; }
  const std::string& place() const override { return place_; }

 private:
  static std::uint8_t byteAt(std::uint64_t offset) {
    return static_cast<std::uint8_t>((offset / 8 + 1) * 0x9E3779B97F4A7C15ULL >> (8 * (offset % 8)));
  }
  std::uint64_t size_;
  std::string place_ = "made://here";
};

}  // namespace repository::test
