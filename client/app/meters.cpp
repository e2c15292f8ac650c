#include "client/app/meters.h"

namespace client {
namespace {

constexpr double kWindow = 1.0;  // seconds
/// A link that was silent for this long has nothing of an older view in it.
constexpr double kQuiet = 0.5;
/// New measurements weigh this much against the old.
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
  // An answer, when one is waited for.
  if (messages != messages_) {
    if (asked_ >= 0.0) {
      const double taken = now - asked_;
      seconds_ = seconds_ > 0.0 ? seconds_ + kShare * (taken - seconds_) : taken;
    }
    asked_ = -1.0;
    messages_ = messages;
    last_message_ = now;
  }

  // A view that left while nothing else was under way.
  if (views != views_) {
    if (asked_ < 0.0 && now - last_message_ >= kQuiet) asked_ = now;
    views_ = views;
  }
}

}  // namespace client
