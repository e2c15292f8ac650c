#pragma once
// The meshes that a command names, with their hashes: hashing takes as long as reading the files.
#include <atomic>
#include <future>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"

namespace server::cli {

/// A thread works out the hashes from the constructor on, while work goes on that does not need them. The destructor
/// stops it.
class SceneSources {
 public:
  using List = std::vector<base::SceneSource>;
  /// Without `hashed` all() has sizes only.
  SceneSources(std::vector<std::string> paths, bool hashed);
  ~SceneSources() { abandoned_ = true; }
  SceneSources(const SceneSources&) = delete;
  SceneSources& operator=(const SceneSources&) = delete;

  /// Checks that all of them are files that can be opened. Does not wait.
  base::Result<void> check() const;
  /// Waits for the hashes. Errors: kNotFound, kIo; kCancelled after stopOnSignals(). Safe from any thread.
  base::Result<List> all() const { return list_.get(); }

 private:
  base::Result<List> describe(bool hashed) const;
  std::vector<std::string> paths_;
  std::atomic<bool> abandoned_{false};
  std::shared_future<base::Result<List>> list_;  // the last member: it ends before the others
};

}  // namespace server::cli
