#include "server/scene/access_log.h"

#include <algorithm>
#include <chrono>

#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr double kLockTimeout = 1.0;      // seconds; another server of the scene may be writing
constexpr double kLastLockTimeout = 5.0;  // seconds; longer at the end, since there is no next time

std::int64_t now() {
  return std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

std::size_t rowsOf(const repository::AccessCounts& counts) {
  return counts.faces.size() + counts.groups.size();
}

}  // namespace

AccessLog::AccessLog(std::string path, const repository::AccessIdentity& identity, double interval_seconds,
                     std::size_t max_keys)
    : path_(std::move(path)),
      identity_(identity),
      interval_seconds_(interval_seconds),
      max_keys_(max_keys),
      counter_(max_keys, [this] { wake(); }),
      place_(path_),
      pending_until_(now()),
      thread_([this](const std::stop_token& stop) { runThread(stop); }) {}

void AccessLog::finish() {
  thread_.request_stop();
  thread_.join();
}

void AccessLog::wake() {
  const std::lock_guard lock(mutex_);
  full_ = true;
  changed_.notify_all();
}

void AccessLog::runThread(const std::stop_token& stop) {
  write(kLockTimeout);  // with no counts yet, so that the log tells at once when the file cannot be written
  std::unique_lock lock(mutex_);
  for (bool last = false; !last;) {
    changed_.wait_for(lock, stop, std::chrono::duration<double>(interval_seconds_), [this] { return full_; });
    full_ = false;
    last = stop.stop_requested();
    lock.unlock();
    write(last ? kLastLockTimeout : kLockTimeout);
    lock.lock();
  }
}

void AccessLog::write(double patience_seconds) {
  repository::AccessCounts taken = counter_.takeCounts();
  const std::int64_t time = now();
  taken.since = std::min(pending_until_, time);
  taken.until = time;
  pending_until_ = time;
  if (rowsOf(pending_) < max_keys_)
    pending_ = repository::addCounts(pending_, taken);
  else
    pending_.uncounted += taken.facesSent() + taken.groupsSent() + taken.uncounted;

  const auto added = repository::addToAccessFile(path_, identity_, pending_, patience_seconds);
  if (!added) return logFailure(added.error());
  pending_ = {};
  const bool has_failed = std::exchange(failing_, false);
  const bool has_moved = std::exchange(place_, *added) != *added;
  if (has_moved && place_ != path_)
    spdlog::info("access counts are kept in {}, since {} has those of another scene", *added, path_);
  else if (has_moved || has_failed)
    spdlog::info("access counts are kept again in {}", *added);
}

void AccessLog::logFailure(const base::Error& error) {
  if (failing_) return;
  failing_ = true;
  spdlog::warn(
      "access counts are not kept for now: {} (--access-file names another place for them, --no-access turns them off)",
      error.message);
}

}  // namespace server
