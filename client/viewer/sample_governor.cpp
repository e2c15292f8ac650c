#include "client/viewer/sample_governor.h"

#include <algorithm>

namespace client {
namespace {

constexpr double kLongestPause = 16.0 * SampleGovernor::kFirstPause;
/// With one sample, frames must stay below this before more are tried. A choice; a display of 60 frames a second has
/// half of the budget.
constexpr double kEasySeconds = 0.6 * SampleGovernor::kBudgetSeconds;
/// A longer frame counts as this long towards the pause, since the view rested for a part of it.
constexpr double kLongestMotion = 0.1;

}  // namespace

std::size_t SampleGovernor::slowerThan(double seconds) const {
  return static_cast<std::size_t>(
      std::count_if(recent_.begin(), recent_.end(), [seconds](double frame) { return frame > seconds; }));
}

void SampleGovernor::change(bool affords_most) {
  if (!affords_most && moved_ < pause_) pause_ = std::min(2.0 * pause_, kLongestPause);
  affords_most_ = affords_most;
  count_ = 0;
  moved_ = 0.0;
}

void SampleGovernor::addFrame(int samples, double seconds) {
  if (most_ <= 1 || samples != whileMoving()) return;
  recent_[count_++ % recent_.size()] = seconds;
  moved_ += std::min(seconds, kLongestMotion);
  if (count_ < recent_.size()) return;
  if (affords_most_ && slowerThan(kBudgetSeconds) + 1 >= recent_.size()) return change(false);
  if (!affords_most_ && moved_ >= pause_ && slowerThan(kEasySeconds) <= 1) change(true);
}

}  // namespace client
