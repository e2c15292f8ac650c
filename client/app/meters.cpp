#include "client/app/meters.h"

namespace client {
namespace {

// Choices: longer windows and smaller shares show steadier figures that follow later.
constexpr double kWindow = 1.0;  // seconds
/// Silence, seconds, after which no answer to an older view is on its way.
constexpr double kQuiet = 0.5;
/// Weight of a new measurement against the older ones.
constexpr double kShare = 0.3;

}  // namespace

void RateMeter::add(double now, double count) {
  while (!entries_.empty() && entries_.front().at <= now - kWindow) entries_.pop_front();
  if (count > 0.0) entries_.push_back({now, count});
}

double RateMeter::perSecond(double now) const {
  double sum = 0.0;
  for (const Entry& entry : entries_)
    if (entry.at > now - kWindow) sum += entry.count;
  return sum / kWindow;
}

void RoundTripMeter::update(double now, std::uint64_t messages, std::uint64_t views) {
  // Take the time of an answer that was awaited.
  if (messages != messages_) {
    if (asked_ >= 0.0) {
      const double taken = now - asked_;
      seconds_ = seconds_ > 0.0 ? seconds_ + kShare * (taken - seconds_) : taken;
    }
    asked_ = -1.0;
    messages_ = messages;
    last_message_ = now;
  }

  // Start the clock for a view that was sent over a silent link.
  if (views != views_) {
    if (asked_ < 0.0 && now - last_message_ >= kQuiet) asked_ = now;
    views_ = views;
  }
}

}  // namespace client
