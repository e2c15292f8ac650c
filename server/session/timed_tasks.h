#pragma once
// Waits for several things that may hang, such as a read of a disk that is gone, no longer than it is given.
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

namespace server {

/// Tasks that run side by side, each on a thread of its own. All calls are for one thread.
class TimedTasks {
 public:
  /// Begins the task. `name` is unlike those of the others.
  void add(const std::string& name, std::function<void()> task);
  /// Waits for all tasks, for so long at most, and returns the names of those that still run. Their threads are left
  /// behind, so all that they use must stay until the process ends.
  std::vector<std::string> wait(double seconds);

 private:
  struct Running {
    std::mutex mutex;
    std::condition_variable changed;
    std::set<std::string> names;
  };
  const std::shared_ptr<Running> running_ = std::make_shared<Running>();
};

}  // namespace server
