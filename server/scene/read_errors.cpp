#include "server/scene/read_errors.h"

#include <utility>

#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr std::size_t kMaxLoggedErrors = 100;

}  // namespace

void ReadErrors::report(const std::string& subject, const base::Error& error) {
  const std::lock_guard guard(mutex_);
  ++count_;
  if (add_) add_(1);
  if (logged_.size() == kMaxLoggedErrors || !logged_.insert(error.message).second) return;
  spdlog::warn("{}: {}", subject, error.message);
  if (logged_.size() == kMaxLoggedErrors) spdlog::warn("no more errors of reading this scene are logged");
}

void ReadErrors::countIn(std::function<void(std::uint64_t)> add) {
  const std::lock_guard guard(mutex_);
  add_ = std::move(add);
  add_(count_);
}

}  // namespace server
