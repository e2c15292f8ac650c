#include "base/file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

namespace base {
namespace {

// Stands between a file's name and its writer's process number until the file is complete.
constexpr const char* kPart = ".part";

std::string directoryOf(const std::string& path) {
  const auto slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// A regular file opened for reading. Opening refuses pipes and devices, and does not wait for a pipe's writer.
struct OpenFile {
  FileDescriptor descriptor;
  std::size_t size = 0;
};
Error noFile(const std::string& path) {
  return {ErrorCode::kUnsupported, path + ": is a pipe or a device; give a file"};
}

Result<OpenFile> openRegular(const std::string& path) {
  FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file) return systemError(path, "open", errno);
  struct stat info {};
  if (::fstat(file.get(), &info) != 0) return systemError(path, "read", errno);
  if (S_ISDIR(info.st_mode)) return systemError(path, "read", EISDIR);
  if (!S_ISREG(info.st_mode)) return noFile(path);
  return OpenFile{std::move(file), static_cast<std::size_t>(info.st_size)};
}

}  // namespace

Error systemError(const std::string& path, const std::string& action, int errno_value) {
  const bool full = errno_value == ENOSPC || errno_value == EDQUOT;
  const ErrorCode code = full ? ErrorCode::kNoSpace : errno_value == ENOENT ? ErrorCode::kNotFound : ErrorCode::kIo;
  std::string message = path + ": cannot " + action + ": " + std::strerror(errno_value);
  if (full) message += "; free some space and run the same command again";
  return {code, message};
}

Result<void> makeDirectories(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (!error) return {};
  return Error{ErrorCode::kIo, path + ": cannot make this directory: " + error.message()};
}

void syncDirectoryOf(const std::string& path) {
  const FileDescriptor directory(::open(directoryOf(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory) ::fsync(directory.get());
}

Result<void> syncFile(const std::string& path) {
  const FileDescriptor file(::open(path.c_str(), O_RDWR | O_CLOEXEC));
  if (!file) return systemError(path, "open", errno);
  if (::fdatasync(file.get()) != 0) return systemError(path, "write", errno);
  return {};
}

Result<void> writeAllAt(const FileDescriptor& file, const std::string& path, std::uint64_t offset, ByteView bytes) {
  while (!bytes.empty()) {
    const ssize_t done = ::pwrite(file.get(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return systemError(path, "write", done == 0 ? ENOSPC : errno);
    bytes = bytes.subspan(static_cast<std::size_t>(done));
    offset += static_cast<std::uint64_t>(done);
  }
  return {};
}

Result<Bytes> readFile(const std::string& path) {
  // Read, not copied from a map: where the disk fails or somebody cuts the file meanwhile, that would be SIGBUS.
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, openRegular(path));
  Bytes bytes(file.size);
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::read(file.descriptor.get(), bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return systemError(path, "read", errno);
    if (n == 0) bytes.resize(done);
    done += static_cast<std::size_t>(n);
  }
  return bytes;
}

Result<void> writeFileAtomically(const std::string& path, ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, AtomicFile::create(path));
  LUMIGRID_TRY(file.write(bytes));
  return file.commit();
}

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

Result<PositionedFile> PositionedFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto opened, openRegular(path));
  return PositionedFile(path, std::move(opened.descriptor), opened.size);
}

Result<void> PositionedFile::readAt(std::uint64_t offset, std::span<std::uint8_t> out) const {
  for (std::size_t done = 0; done < out.size();) {
    const ssize_t n = ::pread(file_.get(), out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return systemError(path_, "read", errno);
    if (n == 0)
      return Error{ErrorCode::kInvalidInput, path_ + ": ends at byte " + std::to_string(offset + done) +
                                                 " instead of " + std::to_string(offset + out.size()) +
                                                 "; copy or build the file again"};
    done += static_cast<std::size_t>(n);
  }
  return {};
}

Result<MappedFile> MappedFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto opened, openRegular(path));
  MappedFile file;
  if (opened.size == 0) return file;
  void* data = ::mmap(nullptr, opened.size, PROT_READ, MAP_SHARED, opened.descriptor.get(), 0);
  if (data == MAP_FAILED) return systemError(path, "map", errno);
  file.data_ = {static_cast<const std::uint8_t*>(data), Unmap{opened.size}};
  return file;
}

void MappedFile::Unmap::operator()(const std::uint8_t* data) const {
  ::munmap(const_cast<std::uint8_t*>(data), size);
}

bool isUnfinished(const std::string& name, const std::string& whole) {
  const std::string front = whole + kPart;
  return name.size() > front.size() && name.rfind(front, 0) == 0 &&
         name.find_first_not_of("0123456789", front.size()) == std::string::npos;
}

void removeUnfinished(const std::string& path) {
  const std::string whole = std::filesystem::path(path).filename().string();
  std::vector<std::filesystem::path> found;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(directoryOf(path), ignored))
    if (isUnfinished(entry.path().filename().string(), whole)) found.push_back(entry.path());
  for (const std::filesystem::path& file : found) std::filesystem::remove(file, ignored);
}

Result<AtomicFile> AtomicFile::create(const std::string& path) {
  // The new file takes the name of what is there, and must not take a device's.
  struct stat there {};
  if (::stat(path.c_str(), &there) == 0 && !S_ISREG(there.st_mode) && !S_ISDIR(there.st_mode)) return noFile(path);
  AtomicFile file;
  file.path_ = path;
  file.temporary_ = path + kPart + std::to_string(::getpid());
  file.file_ = FileDescriptor(::open(file.temporary_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file.file_) return systemError(path, "create", errno);
  return file;
}

AtomicFile::~AtomicFile() {
  if (file_) ::unlink(temporary_.c_str());
}

Result<void> AtomicFile::write(ByteView bytes) {
  const std::uint64_t offset = size_;
  LUMIGRID_TRY(writeAt(offset, bytes));
  size_ = offset + bytes.size();
  return {};
}

Result<void> AtomicFile::writeAt(std::uint64_t offset, ByteView bytes) {
  return writeAllAt(file_, path_, offset, bytes);
}

Result<void> AtomicFile::commit() {
  if (::fsync(file_.get()) != 0) return systemError(path_, "write", errno);
  const char* failed = nullptr;
  if (::close(file_.release()) != 0)
    failed = "write";
  else if (::rename(temporary_.c_str(), path_.c_str()) != 0)
    failed = "rename into place";
  if (failed != nullptr) {
    const int error = errno;
    ::unlink(temporary_.c_str());
    return systemError(path_, failed, error);
  }
  syncDirectoryOf(path_);
  return {};
}

}  // namespace base
