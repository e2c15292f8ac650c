#pragma once
// Reads whole files, and writes files that appear only when they are complete.
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "base/bytes.h"
#include "base/error.h"

namespace base {

/// Errors: kNotFound, kIo; kUnsupported for pipes and devices.
Result<Bytes> readFile(const std::string& path);
/// Writes to a temporary name beside `path`, fsyncs, renames: `path` holds the old bytes or all of the new ones.
Result<void> writeFileAtomically(const std::string& path, ByteView bytes);

/// Makes a directory and those above it, as far as they are missing. kIo; the error names it.
Result<void> makeDirectories(const std::string& path);

/// Waits until everything that any process wrote to the file is on the disk. Errors: kNoSpace, kIo, kNotFound.
Result<void> syncFile(const std::string& path);

/// Fsyncs the directory that holds `path`, without which a rename is not durable. Failures are ignored, since some file
/// systems do not support it.
void syncDirectoryOf(const std::string& path);

/// A descriptor of an open file, closed with the object. An flock on it goes with it.
class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}  ///< a descriptor that open() returned; below 0: none
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor();
  int get() const { return fd_; }
  int release() { return std::exchange(fd_, -1); }  ///< without closing it
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_;
};

/// Writes all the bytes from `offset` on. `path` is for errors: kNoSpace, kIo.
Result<void> writeAllAt(const FileDescriptor& file, const std::string& path, std::uint64_t offset, ByteView bytes);

/// A file that is read in parts, by position. It is not mapped: where the disk fails or somebody cuts the file, reading
/// returns an error. May be read from several threads.
class PositionedFile {
 public:
  /// Errors as readFile.
  static Result<PositionedFile> open(const std::string& path);
  /// Fills `out` with the bytes from `offset` on. Errors: kInvalidInput where the file ends before, kIo.
  Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const;
  std::uint64_t size() const { return size_; }  ///< when it was opened
  const std::string& path() const { return path_; }

 private:
  PositionedFile(std::string path, FileDescriptor file, std::uint64_t size)
      : path_(std::move(path)), file_(std::move(file)), size_(size) {}

  std::string path_;
  FileDescriptor file_;
  std::uint64_t size_;
};

/// A read-only memory map of a whole file.
class MappedFile {
 public:
  /// Errors as readFile.
  static Result<MappedFile> open(const std::string& path);
  ByteView bytes() const { return data_ ? ByteView(data_.get(), data_.get_deleter().size) : ByteView(); }

 private:
  struct Unmap {
    std::size_t size;
    void operator()(const std::uint8_t* data) const;
  };
  std::unique_ptr<const std::uint8_t, Unmap> data_;
};

/// Whether `name` is a temporary file that a killed AtomicFile of `whole` left beside it.
bool isUnfinished(const std::string& name, const std::string& whole);
/// Removes such files of `path`. None of them may still have a writer.
void removeUnfinished(const std::string& path);

/// A file written front to back under a temporary name. commit() fsyncs and renames it to its own; without it the
/// temporary is removed.
class AtomicFile {
 public:
  static Result<AtomicFile> create(const std::string& path);
  AtomicFile(AtomicFile&& other) noexcept = default;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();
  Result<void> write(ByteView bytes);
  /// Overwrites bytes already written.
  Result<void> writeAt(std::uint64_t offset, ByteView bytes);
  Result<void> commit();
  std::uint64_t size() const { return size_; }

 private:
  AtomicFile() = default;
  std::string path_;
  std::string temporary_;
  FileDescriptor file_;
  std::uint64_t size_ = 0;
};

/// "No space left on device" and its like as one line for `path`; code kNoSpace for a full disk or quota, else kIo.
Error systemError(const std::string& path, const std::string& action, int errno_value);

}  // namespace base
