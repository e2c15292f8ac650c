#pragma once
// A file of the builder's own that is written front to back and read at any place: what does not fit into memory.
#include <cstdint>
#include <span>
#include <string>

#include "base/bytes.h"
#include "base/error.h"

namespace lod::ingest {

/// Appends are buffered; reads see what was flushed. Reading is safe from several threads, writing from one.
class SpoolFile {
 public:
  /// An empty file; whatever was there is gone. Errors: kNoSpace, kIo.
  static base::Result<SpoolFile> create(const std::string& path);
  /// A file that is there, to be read and continued. Errors: kNotFound, kIo.
  static base::Result<SpoolFile> open(const std::string& path);
  SpoolFile() = default;
  SpoolFile(SpoolFile&& other) noexcept;
  SpoolFile& operator=(SpoolFile&& other) noexcept;
  ~SpoolFile();  ///< closes; the file stays, without what was not flushed

  base::Result<void> append(base::ByteView bytes);
  base::Result<void> flush();
  /// Flushes, and waits until the disk has it.
  base::Result<void> sync();
  /// Cuts the file to its first `size` bytes.
  base::Result<void> truncate(std::uint64_t size);
  /// Fills `out` from `offset` on; an error where the file ends before.
  base::Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const;
  /// Overwrites bytes flushed earlier.
  base::Result<void> writeAt(std::uint64_t offset, base::ByteView bytes);
  /// Tells the system that these bytes will not be read again, so that it can give the disk space back at once.
  void release(std::uint64_t offset, std::uint64_t length);
  std::uint64_t size() const { return flushed_ + buffer_.size(); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  int fd_ = -1;
  std::uint64_t flushed_ = 0;
  base::Bytes buffer_;
};

}  // namespace lod::ingest
