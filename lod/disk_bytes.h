#pragma once
// A hierarchy's file on disk. It is read by position and not mapped: a file that is cut while it is open cannot be read
// there, and kills nobody (docs/decisions/reads-that-cannot-kill.md).
#include <utility>

#include "base/file.h"
#include "lod/file_bytes.h"

namespace lod {

class DiskBytes final : public FileBytes {
 public:
  explicit DiskBytes(base::PositionedFile file) : file_(std::move(file)) {}
  bool read(std::uint64_t offset, std::span<std::uint8_t> out) const override {
    return bool(file_.readAt(offset, out));
  }
  std::uint64_t size() const override { return file_.size(); }

 private:
  base::PositionedFile file_;
};

}  // namespace lod
