#pragma once
// One process at a time decides about a scene as a whole: opens or makes it, builds its hierarchy, declares it
// finished. Images are written outside of it, each shard under the lock of its own store.
#include <functional>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace server::cli {

/// SCENE/build.lock, held by flock: the system gives it back when its process dies. Gone when nobody holds it.
class SceneLock {
 public:
  /// Waits until nobody else holds it; makes the directory when it is not there. `on_wait` is called once with who has
  /// it ("pid 12 on node3"), when there is somebody to wait for. Errors: kCancelled after stopOnSignals(), kExists when
  /// the directory is a file, kIo.
  static base::Result<SceneLock> take(const std::string& directory,
                                      const std::function<void(const std::string& holder)>& on_wait);
  SceneLock(SceneLock&& other) noexcept;
  SceneLock& operator=(SceneLock&&) = delete;
  /// Removes a directory that take() made and that is still empty.
  ~SceneLock();

 private:
  SceneLock() = default;
  std::string directory_;
  base::FileDescriptor file_;
  bool made_directory_ = false;
};

/// The lock's name within a scene.
inline constexpr const char* kLockFile = "build.lock";

}  // namespace server::cli
