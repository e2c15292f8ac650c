#include "server/cli/scene_lock.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <filesystem>
#include <thread>
#include <utility>

#include "base/file.h"
#include "base/file_lock.h"
#include "server/cli/console.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
constexpr auto kPollInterval = std::chrono::milliseconds(100);  // nobody notices, and hundreds of tasks may wait

std::string holderName() {
  std::array<char, 256> host{};
  if (::gethostname(host.data(), host.size() - 1) != 0) host[0] = 0;
  return "pid " + std::to_string(::getpid()) + " on " + host.data();
}

std::string readHolder(const std::string& path) {
  const base::FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  std::array<char, 300> text{};
  const ssize_t size = file ? ::pread(file.get(), text.data(), text.size(), 0) : -1;
  return size <= 0 ? "another process" : std::string(text.data(), static_cast<std::size_t>(size));
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

base::Result<SceneLock> SceneLock::acquire(const std::string& directory,
                                           const std::function<void(const std::string& holder)>& on_wait) {
  const std::string path = directory + "/" + kLockFile;
  SceneLock lock;
  lock.directory_ = directory;
  bool told = false;
  for (;;) {
    LUMIGRID_ASSIGN_OR_RETURN(auto made, makeDirectory(directory));
    lock.made_directory_ = lock.made_directory_ || made;
    auto file = base::tryLockFile(path);
    if (file) {
      lock.file_ = std::move(*file);
      break;
    }
    if (file.error().code == base::ErrorCode::kNotFound) continue;  // somebody removed the directory that was empty
    if (file.error().code != base::ErrorCode::kBusy) return file.error();
    if (!std::exchange(told, true)) on_wait(readHolder(path));
    if (stopRequested())
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    std::this_thread::sleep_for(kPollInterval);
  }
  const std::string holder = holderName();
  if (::ftruncate(lock.file_.get(), 0) == 0 && ::pwrite(lock.file_.get(), holder.data(), holder.size(), 0) < 0)
    errno = 0;  // only for the message that others give: a full disk may not stop us here
  return lock;
}

SceneLock::SceneLock(SceneLock&& other) noexcept
    : directory_(std::move(other.directory_)),
      file_(std::move(other.file_)),
      made_directory_(std::exchange(other.made_directory_, false)) {}

SceneLock::~SceneLock() {
  if (!file_) return;
  ::unlink((directory_ + "/" + kLockFile).c_str());
  { const base::FileDescriptor freed = std::move(file_); }
  std::error_code ignored;
  if (made_directory_) fs::remove(directory_, ignored);
}

}  // namespace server::cli
