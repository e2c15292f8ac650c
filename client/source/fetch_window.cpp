#include "client/source/fetch_window.h"

#include <algorithm>

namespace client {
namespace {

constexpr double kMemory = 5.0;  // seconds; a choice
constexpr double kGain = 2.0;    // as BBR's
/// Beyond what an idle link took, seconds: a choice (docs/decisions/static-scenes.md). Over 384 kbit/s it is half of
/// kLeastBytes.
constexpr double kAhead = 0.15;

}  // namespace

void FetchWindow::answered(const Mark& sent, const Mark& now) {
  const double took = now.at - sent.at;
  if (!(took > 0.0) || now.received <= sent.received) return;
  samples_[count_++ % samples_.size()] = {now.at, took, static_cast<double>(now.received - sent.received) / took};
  if (sent.was_idle) idle_took_[idle_count_++ % idle_took_.size()] = took;
}

double FetchWindow::rate() const {
  if (count_ == 0) return 0.0;
  const double newest = samples_[(count_ - 1) % samples_.size()].at;
  double rate = 0.0;
  for (const Sample& sample : samples_)
    if (sample.at >= newest - kMemory) rate = std::max(rate, sample.rate);
  return rate;
}

std::uint64_t FetchWindow::bytes() const {
  if (count_ == 0) return kFirstBytes;
  const double newest = samples_[(count_ - 1) % samples_.size()].at;
  double took = kMemory;
  for (const Sample& sample : samples_)
    if (sample.at >= newest - kMemory) took = std::min(took, sample.took);
  double idle_took = kMemory;
  for (std::size_t i = 0; i < std::min(idle_count_, idle_took_.size()); ++i)
    idle_took = std::min(idle_took, idle_took_[i]);
  const double ahead = std::min(kGain * took, idle_took + kAhead);
  return std::max(kLeastBytes, static_cast<std::uint64_t>(rate() * ahead));
}

}  // namespace client
