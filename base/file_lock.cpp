#include "base/file_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <thread>

namespace base {
namespace {

// Between two attempts to get a lock that somebody holds. A choice: longer pauses waste the time after it was released,
// shorter ones wake the waiting process more often.
constexpr std::chrono::milliseconds kPause(2);

bool isCalled(int fd, const std::string& path) {
  struct stat ours {};
  struct stat named {};
  return ::fstat(fd, &ours) == 0 && ::stat(path.c_str(), &named) == 0 && ours.st_dev == named.st_dev &&
         ours.st_ino == named.st_ino;
}

Result<FileDescriptor> lock(const std::string& path, int operation) {
  for (;;) {
    FileDescriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
    if (!file) return systemError(path, "open", errno);
    int refused = 0;
    do {
      refused = ::flock(file.get(), operation);
    } while (refused != 0 && errno == EINTR);
    if (refused != 0 && errno == EWOULDBLOCK)
      return Error{ErrorCode::kBusy, path + " is held by another process; wait for it or stop it"};
    if (refused != 0) return systemError(path, "lock", errno);
    if (isCalled(file.get(), path)) return file;
  }
}

}  // namespace

Result<FileDescriptor> lockFile(const std::string& path) {
  return lock(path, LOCK_EX);
}

Result<FileDescriptor> tryLockFile(const std::string& path, double patience_seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience_seconds);
  for (;;) {
    auto file = lock(path, LOCK_EX | LOCK_NB);
    if (file || file.error().code != ErrorCode::kBusy || std::chrono::steady_clock::now() >= end) return file;
    std::this_thread::sleep_for(kPause);
  }
}

void writeHolder(const FileDescriptor& lock, const std::string& holder) {
  if (::ftruncate(lock.get(), 0) == 0 && ::pwrite(lock.get(), holder.data(), holder.size(), 0) < 0) errno = 0;
}

std::string readHolder(const std::string& path) {
  const FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  std::array<char, 300> text{};
  const ssize_t size = file ? ::pread(file.get(), text.data(), text.size(), 0) : -1;
  const std::string holder(text.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  return holder.substr(0, holder.find('\n'));
}

}  // namespace base
