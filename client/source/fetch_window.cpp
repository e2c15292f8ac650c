#include "client/source/fetch_window.h"

#include <algorithm>

namespace client {
namespace {

constexpr double kMemory = 5.0;  // seconds; a choice
constexpr double kGain = 2.0;    // as BBR's
/// Beyond what an idle link took, seconds: a choice (docs/decisions/static-scenes.md).
constexpr double kAhead = 0.15;
/// A link is seldom idle while an eye moves, so that its answers count for longer, seconds: a choice.
constexpr double kIdleMemory = 30.0;
constexpr double kLeastTime = 0.005;  // seconds; differences of times below it say nothing

}  // namespace

void FetchWindow::answered(const Mark& sent, const Mark& now) {
  const double took = now.at - sent.at;
  if (!(took > 0.0) || now.received <= sent.received) return;
  const Sample sample{now.at, took, static_cast<double>(now.received - sent.received) / took};
  samples_[count_++ % samples_.size()] = sample;
  if (sent.was_idle) idle_[idle_count_++ % idle_.size()] = sample;
}

double FetchWindow::rate() const {
  if (count_ == 0) return 0.0;
  const double newest = samples_[(count_ - 1) % samples_.size()].at;
  double rate = 0.0;
  for (const Sample& sample : samples_)
    if (sample.at >= newest - kMemory) rate = std::max(rate, sample.rate);
  return rate;
}

double FetchWindow::rateOnceBegun() const {
  double quickest = kMemory;
  for (const Sample& sample : idle_) quickest = std::min(quickest, sample.rate > 0.0 ? sample.took : kMemory);
  double rate = 0.0;
  for (const Sample& sample : idle_)
    if (sample.took > quickest)
      rate = std::max(rate, sample.rate * sample.took / std::max(kLeastTime, sample.took - quickest));
  return rate;
}

std::uint64_t FetchWindow::bytes() const {
  if (count_ == 0) return kFirstBytes;
  const double newest = samples_[(count_ - 1) % samples_.size()].at;
  double took = kMemory;
  for (const Sample& sample : samples_)
    if (sample.at >= newest - kMemory) took = std::min(took, sample.took);
  // The last one counts however old it is.
  double idle_took = idle_count_ != 0 ? idle_[(idle_count_ - 1) % idle_.size()].took : kMemory;
  for (const Sample& sample : idle_)
    if (sample.at >= newest - kIdleMemory) idle_took = std::min(idle_took, sample.took);
  const double ahead = std::min(kGain * took, idle_took + kAhead);
  return std::max(kLeastBytes, static_cast<std::uint64_t>(rate() * ahead));
}

}  // namespace client
