#pragma once
// One process at a time decides about a scene as a whole: it opens or makes the scene, builds its hierarchy, declares
// it finished. Images are written outside of this lock, each shard under the lock of its own store.
#include <functional>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace server::cli {

/// Holds SCENE/build.lock by flock: the system releases it when the process dies. The file goes when nobody holds it.
class SceneLock {
 public:
  /// Waits until nobody else holds it; makes the directory when it is not there. `on_wait` is called once with who has
  /// it ("pid 12 on node3"), when there is somebody to wait for. Errors: kCancelled after stopOnSignals(), kExists when
  /// the directory is a file, kIo.
  static base::Result<SceneLock> acquire(const std::string& directory,
                                         const std::function<void(const std::string& holder)>& on_wait);
  SceneLock(SceneLock&&) noexcept = default;
  SceneLock& operator=(SceneLock&&) = delete;
  /// Removes a directory that acquire() made and that is still empty.
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
