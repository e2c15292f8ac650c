#include "server/session/timed_tasks.h"

#include <chrono>
#include <system_error>
#include <thread>
#include <utility>

namespace server {

void TimedTasks::add(const std::string& name, std::function<void()> task) {
  {
    const std::lock_guard lock(running_->mutex);
    running_->names.insert(name);
  }
  auto work = [running = running_, name, task = std::move(task)]() mutable {
    task();
    task = nullptr;  // whoever waits ends what it holds
    const std::lock_guard lock(running->mutex);
    running->names.erase(name);
    running->changed.notify_all();
  };
  try {
    std::thread(work).detach();
  } catch (const std::system_error&) {
    work();  // the system has no thread left, so that nothing can limit this
  }
}

std::vector<std::string> TimedTasks::wait(double seconds) {
  std::unique_lock lock(running_->mutex);
  running_->changed.wait_for(lock, std::chrono::duration<double>(seconds), [this] { return running_->names.empty(); });
  return {running_->names.begin(), running_->names.end()};
}

}  // namespace server
