#include "lod/ingest/spool.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

namespace lod::ingest {
namespace {

// Bytes that are collected before they are written. A choice: smaller buffers make more system calls, larger ones take
// more memory for each open file.
constexpr std::size_t kSpoolBufferBytes = std::size_t{1} << 20;

}  // namespace

base::Result<SpoolFile> SpoolFile::create(const std::string& path) {
  SpoolFile file;
  file.path_ = path;
  file.file_ = base::FileDescriptor(::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file.file_) return base::systemError(path, "create", errno);
  return file;
}

base::Result<SpoolFile> SpoolFile::open(const std::string& path) {
  SpoolFile file;
  file.path_ = path;
  file.file_ = base::FileDescriptor(::open(path.c_str(), O_RDWR | O_CLOEXEC));
  if (!file.file_) return base::systemError(path, "open", errno);
  const off_t end = ::lseek(file.file_.get(), 0, SEEK_END);
  if (end < 0) return base::systemError(path, "read", errno);
  file.flushed_ = static_cast<std::uint64_t>(end);
  return file;
}

base::Result<void> SpoolFile::append(base::ByteView bytes) {
  // Large pieces skip the buffer and go straight to the file, behind what is buffered.
  const bool large = bytes.size() > kSpoolBufferBytes / 8;
  if (large || buffer_.size() + bytes.size() > kSpoolBufferBytes) LUMIGRID_TRY(flush());
  if (large) {
    LUMIGRID_TRY(base::writeAllAt(file_, path_, flushed_, bytes));
    flushed_ += bytes.size();
    return {};
  }
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  return {};
}

base::Result<void> SpoolFile::flush() {
  LUMIGRID_TRY(base::writeAllAt(file_, path_, flushed_, buffer_));
  flushed_ += buffer_.size();
  buffer_.clear();
  return {};
}

base::Result<void> SpoolFile::sync() {
  LUMIGRID_TRY(flush());
  if (::fdatasync(file_.get()) != 0) return base::systemError(path_, "write", errno);
  return {};
}

base::Result<void> SpoolFile::truncate(std::uint64_t size) {
  buffer_.clear();
  if (::ftruncate(file_.get(), static_cast<off_t>(size)) != 0) return base::systemError(path_, "cut", errno);
  flushed_ = size;
  return {};
}

base::Result<void> SpoolFile::readAt(std::uint64_t offset, std::span<std::uint8_t> out) const {
  while (!out.empty()) {
    const ssize_t n = ::pread(file_.get(), out.data(), out.size(), static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return base::systemError(path_, "read", errno);
    if (n == 0)
      return base::Error{base::ErrorCode::kIo, path_ + ": ends before byte " + std::to_string(offset + out.size()) +
                                                   "; somebody changed it: build again with --force"};
    offset += static_cast<std::uint64_t>(n);
    out = out.subspan(static_cast<std::size_t>(n));
  }
  return {};
}

base::Result<void> SpoolFile::writeAt(std::uint64_t offset, base::ByteView bytes) {
  return base::writeAllAt(file_, path_, offset, bytes);
}

void SpoolFile::forget(std::uint64_t offset, std::uint64_t length) const {
  (void)::posix_fadvise(file_.get(), static_cast<off_t>(offset), static_cast<off_t>(length), POSIX_FADV_DONTNEED);
}

void SpoolFile::release([[maybe_unused]] std::uint64_t offset, [[maybe_unused]] std::uint64_t length) {
#ifdef FALLOC_FL_PUNCH_HOLE
  // Where the file system cannot punch holes, the space is freed when the file is removed.
  (void)::fallocate(file_.get(), FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(offset),
                    static_cast<off_t>(length));
#endif
}

}  // namespace lod::ingest
