#include "server/net/hosted_scene.h"

#include <filesystem>
#include <mutex>
#include <set>

#include "spdlog/spdlog.h"

namespace server {

void HostedScene::startAccessLog(const ServerOptions& options, const std::string& scene_directory) {
  if (!hasPatches()) return;
  std::string path = options.access_file;
  std::error_code ignored;
  if (path.empty()) {
    if (!std::filesystem::is_directory(scene_directory, ignored)) {
      spdlog::warn("access counts are not kept: {} is no directory; --access-file names a place for them",
                   scene_directory);
      return;
    }
    path = repository::accessFileOf(scene_directory);
  }
  access = std::make_unique<AccessLog>(path, accessIdentityOf(*scene), options.access_interval_seconds);
  scene->data.access = &access->counter();
}

void HostedScene::endAccessLog() {
  scene->data.access = nullptr;
  access.reset();
}

void logImageErrors(OpenScene& scene) {
  if (scene.packs == nullptr) return;
  constexpr std::size_t kMaxLoggedErrors = 100;
  struct LoggedErrors {
    std::mutex mutex;
    std::set<std::string> messages;
  };
  scene.packs->setErrorListener([logged = std::make_shared<LoggedErrors>()](const base::Error& error) {
    const std::lock_guard guard(logged->mutex);
    if (logged->messages.size() < kMaxLoggedErrors && logged->messages.insert(error.message).second)
      spdlog::warn("image: {}", error.message);
  });
}

}  // namespace server
