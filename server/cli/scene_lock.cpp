#include "server/cli/scene_lock.h"

#include <unistd.h>

#include <array>
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
    if (!std::exchange(told, true)) {
      const std::string holder = base::readHolder(path);
      on_wait(holder.empty() ? "another process" : holder);
    }
    if (stopRequested())
      return base::Error{base::ErrorCode::kCancelled, "stopped; the same command goes on where it stopped"};
    std::this_thread::sleep_for(kPollInterval);
  }
  base::writeHolder(lock.file_, holderName());
  return lock;
}

SceneLock::~SceneLock() {
  if (!file_) return;
  ::unlink((directory_ + "/" + kLockFile).c_str());
  { const base::FileDescriptor freed = std::move(file_); }
  std::error_code ignored;
  if (made_directory_) fs::remove(directory_, ignored);
}

}  // namespace server::cli
