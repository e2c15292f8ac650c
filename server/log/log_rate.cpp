#include "server/log/log_rate.h"

#include <algorithm>

namespace server {
namespace {

constexpr auto kWindow = std::chrono::seconds(1);
constexpr std::size_t kMaxKinds = 64;  // the server's code has some 30; all others share one window

}  // namespace

bool LogRate::admit(std::string_view kind, Clock::time_point now) {
  if (lines_per_second_ == 0) return true;
  if (windows_.size() >= kMaxKinds && windows_.find(kind) == windows_.end()) kind = "";
  Window& window = windows_.try_emplace(std::string(kind)).first->second;
  if (now >= window.end) {
    window.end = now + kWindow;
    window.admitted = 0;
  }
  if (window.admitted < lines_per_second_) {
    ++window.admitted;
    return true;
  }
  ++window.left_out;
  return false;
}

std::vector<LogRate::Summary> LogRate::takeSummaries(Clock::time_point now) {
  std::vector<Summary> summaries;
  for (auto& [kind, window] : windows_) {
    if (window.left_out == 0 || now < window.end) continue;
    summaries.push_back({kind, window.left_out});
    window.left_out = 0;
  }
  return summaries;
}

std::optional<LogRate::Clock::time_point> LogRate::nextSummary() const {
  std::optional<Clock::time_point> next;
  for (const auto& [kind, window] : windows_)
    if (window.left_out > 0) next = std::min(next.value_or(window.end), window.end);
  return next;
}

}  // namespace server
