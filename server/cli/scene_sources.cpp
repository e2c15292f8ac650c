#include "server/cli/scene_sources.h"

#include <filesystem>

#include "base/file.h"
#include "server/cli/console.h"

namespace server::cli {

SceneSources::SceneSources(std::vector<std::string> paths, bool hashed) : paths_(std::move(paths)) {
  list_ = std::async(hashed ? std::launch::async : std::launch::deferred, [this, hashed] {
            return describe(hashed);
          }).share();
}

base::Result<void> SceneSources::check() const {
  for (const std::string& path : paths_)
    if (const auto file = base::MappedFile::open(path); !file) return file.error();
  return {};
}

base::Result<SceneSources::List> SceneSources::describe(bool hashed) const {
  List sources;
  for (const std::string& path : paths_) {
    auto hash = hashed ? base::sha256OfFile(path, [this] { return !abandoned_ && !stopRequested(); })
                       : base::Result<std::string>("");
    if (!hash) return hash.error();
    std::error_code ignored;
    sources.push_back({path, std::filesystem::file_size(path, ignored), *hash});
  }
  return sources;
}

}  // namespace server::cli
