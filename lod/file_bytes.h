#pragma once
// The bytes of a hierarchy's file, wherever they lie.
#include <algorithm>
#include <cstdint>
#include <span>

#include "base/bytes.h"

namespace lod {

/// Reads parts of a file. Safe to use from several threads.
class FileBytes {
 public:
  virtual ~FileBytes() = default;
  /// Fills `out` with the bytes from `offset` on; false when they are not there or cannot be read.
  virtual bool read(std::uint64_t offset, std::span<std::uint8_t> out) const = 0;
  virtual std::uint64_t size() const = 0;
};

/// A whole file in memory, which must outlive this.
class MemoryBytes final : public FileBytes {
 public:
  explicit MemoryBytes(base::ByteView file) : file_(file) {}
  bool read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    if (offset > file_.size() || out.size() > file_.size() - offset) return false;
    std::copy_n(file_.data() + offset, out.size(), out.data());
    return true;
  }
  std::uint64_t size() const override { return file_.size(); }

 private:
  base::ByteView file_;
};

}  // namespace lod
