#pragma once
// A work file that is written front to back and read anywhere, for data that does not fit into memory.
#include <cstdint>
#include <span>
#include <string>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"

namespace lod::ingest {

/// A part of a file.
struct Extent {
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;
};

/// Appended bytes are buffered, and can be read once they are flushed; closing the file does not flush them. Reading is
/// safe from several threads, writing from one.
class SpoolFile {
 public:
  /// Creates an empty file in place of whatever was there. Errors: kNoSpace, kIo.
  static base::Result<SpoolFile> create(const std::string& path);
  /// Opens an existing file to be read and continued. Errors: kNotFound, kIo.
  static base::Result<SpoolFile> open(const std::string& path);
  SpoolFile() = default;

  base::Result<void> append(base::ByteView bytes);
  base::Result<void> flush();
  /// Flushes, and waits until the bytes are on disk.
  base::Result<void> sync();
  /// Shortens the file to its first `size` bytes.
  base::Result<void> truncate(std::uint64_t size);
  /// Reads the bytes from `offset` on into all of `out`; a file that ends before is an error.
  base::Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const;
  /// Overwrites bytes that were flushed earlier.
  base::Result<void> writeAt(std::uint64_t offset, base::ByteView bytes);
  /// Frees the disk space of these bytes, which will not be read again.
  void release(std::uint64_t offset, std::uint64_t length);
  /// Frees the memory in which the system keeps these bytes beside the disk, as far as they are on it. Where many bytes
  /// are copied once, the copy then takes that memory in place of other.
  void forget(std::uint64_t offset, std::uint64_t length) const;
  std::uint64_t size() const { return flushed_ + buffer_.size(); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  base::FileDescriptor file_;
  std::uint64_t flushed_ = 0;
  base::Bytes buffer_;
};

}  // namespace lod::ingest
