#include "server/cmd/scene_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <thread>
#include <utility>

#include "base/file.h"
#include "server/cmd/console.h"

namespace server::cmd {
namespace {

namespace fs = std::filesystem;
constexpr auto kPollInterval = std::chrono::milliseconds(100);

std::string holderName() {
  std::array<char, 256> host{};
  if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = 0;
  return "pid " + std::to_string(::getpid()) + " on " + host.data();
}

std::string readHolder(int fd) {
  std::array<char, 300> text{};
  const ssize_t size = ::pread(fd, text.data(), text.size(), 0);
  return size <= 0 ? "another process" : std::string(text.data(), static_cast<std::size_t>(size));
}

// Its last holder removes the file: a lock on what is gone from the directory is none.
bool isStillThere(int fd, const std::string& path) {
  struct stat ours {};
  struct stat named {};
  return ::fstat(fd, &ours) == 0 && ::stat(path.c_str(), &named) == 0 && ours.st_dev == named.st_dev &&
         ours.st_ino == named.st_ino;
}

base::Result<bool> makeDirectory(const std::string& directory) {
  std::error_code error;
  const bool made = fs::create_directories(directory, error);
  if (error == std::errc::not_a_directory || (!error && !fs::is_directory(directory)))
    return base::Error{base::ErrorCode::kExists,
                       directory + ": is a file, not a scene directory; choose another output"};
  if (error) return base::systemError(directory, "make this directory", error.value());
  return made;
}

}  // namespace

base::Result<SceneLock> SceneLock::take(const std::string& directory,
                                        const std::function<void(const std::string& holder)>& on_wait) {
  const std::string path = directory + "/" + kLockFile;
  SceneLock lock;
  lock.directory_ = directory;
  bool told = false;
  for (;;) {
    auto made = makeDirectory(directory);
    if (!made) return made.error();
    lock.made_directory_ = lock.made_directory_ || *made;
    const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (fd < 0 && errno == ENOENT) continue;  // somebody removed the directory that nothing was in
    if (fd < 0) return base::systemError(path, "create", errno);
    if (::flock(fd, LOCK_EX | LOCK_NB) == 0 && isStillThere(fd, path)) {
      lock.fd_ = fd;
      break;
    }
    if (!std::exchange(told, true)) on_wait(readHolder(fd));
    ::close(fd);
    if (stopRequested())
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    std::this_thread::sleep_for(kPollInterval);
  }
  const std::string holder = holderName();
  if (::ftruncate(lock.fd_, 0) == 0 && ::pwrite(lock.fd_, holder.data(), holder.size(), 0) < 0)
    errno = 0;  // only for the message that others give: a full disk may not stop us here
  return lock;
}

SceneLock::SceneLock(SceneLock&& other) noexcept
    : directory_(std::move(other.directory_)),
      fd_(std::exchange(other.fd_, -1)),
      made_directory_(std::exchange(other.made_directory_, false)) {}

SceneLock::~SceneLock() {
  if (fd_ < 0) return;
  ::unlink((directory_ + "/" + kLockFile).c_str());
  ::close(fd_);
  std::error_code ignored;
  if (made_directory_) fs::remove(directory_, ignored);
}

}  // namespace server::cmd
