#include "client/source/fetch_window.h"

#include <algorithm>

namespace client {
namespace {

constexpr double kMemory = 5.0;  // seconds; a choice
constexpr double kGain = 2.0;    // as BBR's

}  // namespace

void FetchWindow::answered(const Mark& sent, const Mark& now) {
  const double took = now.at - sent.at;
  if (!(took > 0.0) || now.received <= sent.received) return;
  samples_[count_++ % samples_.size()] = {now.at, took, static_cast<double>(now.received - sent.received) / took};
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
  if (count_ == 0) return kLeastBytes;
  const double newest = samples_[(count_ - 1) % samples_.size()].at;
  double took = kMemory;
  for (const Sample& sample : samples_)
    if (sample.at >= newest - kMemory) took = std::min(took, sample.took);
  return std::max(kLeastBytes, static_cast<std::uint64_t>(kGain * rate() * took));
}

}  // namespace client
