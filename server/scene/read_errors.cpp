#include "server/scene/read_errors.h"

#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr std::size_t kMaxLoggedErrors = 100;

}  // namespace

void ReadErrors::report(const std::string& subject, const base::Error& error) {
  ++count_;
  const std::lock_guard guard(mutex_);
  if (logged_.size() == kMaxLoggedErrors || !logged_.insert(error.message).second) return;
  spdlog::warn("{}: {}", subject, error.message);
  if (logged_.size() == kMaxLoggedErrors) spdlog::warn("no more errors of reading this scene are logged");
}

}  // namespace server
