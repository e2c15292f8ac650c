#include "client/viewer/draw_governor.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace client {
namespace {

constexpr int kAllSamples = 0;
constexpr int kFewPoints = 6;
/// Measured: docs/decisions/moving-effort.md.
constexpr DrawEffort kEfforts[] = {{kAllSamples}, {1}, {1, 0.7F}, {1, 0.5F}, {1, 0.5F, kFewPoints}};
/// An effort's cost over that of the next one, about; the larger steps are found too large when they are tried.
constexpr double kUsualStep = 1.5;
constexpr double kLongestPause = 16.0 * DrawGovernor::kFirstPause;
/// Frames must stay below this share of the budget before more effort is tried, which costs up to twice as much.
constexpr double kEasyShare = 0.5;
/// Beyond so many budgets three frames are enough to tell.
constexpr double kFarTooSlow = 3.0;
constexpr std::size_t kFewFrames = 3;
/// A longer frame counts as this long towards the pause, since the view rested for a part of it.
constexpr double kLongestMotion = 0.1;

}  // namespace

std::vector<DrawEffort> DrawGovernor::efforts(int most_samples) {
  std::vector<DrawEffort> efforts;
  for (DrawEffort effort : kEfforts) {
    if (effort.samples == kAllSamples) effort.samples = most_samples;
    if (efforts.empty() || effort != efforts.back()) efforts.push_back(effort);
  }
  return efforts;
}

DrawGovernor::DrawGovernor(int most_samples, bool slow, double rate)
    : efforts_(efforts(most_samples)), budget_(rate > 0.0 ? 1.0 / rate : std::numeric_limits<double>::infinity()) {
  if (slow && rate > 0.0)
    while (efforts_[level_].samples > 1) ++level_;
}

std::size_t DrawGovernor::slowerThan(double seconds) const {
  const std::size_t known = std::min(count_, recent_.size());
  return static_cast<std::size_t>(std::count_if(recent_.begin(), recent_.begin() + static_cast<std::ptrdiff_t>(known),
                                                [seconds](double frame) { return frame > seconds; }));
}

bool DrawGovernor::isTooSlow() const {
  if (count_ >= recent_.size()) return slowerThan(budget_) + 1 >= recent_.size();
  return count_ >= kFewFrames && slowerThan(kFarTooSlow * budget_) == count_;
}

/// Returns by how many levels to go down: the second fastest of the last frames tells by how much they are too slow.
std::size_t DrawGovernor::stepsDown() const {
  double fastest = std::max(recent_[0], recent_[1]), second = fastest;
  for (std::size_t i = 0; i < std::min(count_, recent_.size()); ++i) {
    if (recent_[i] < fastest)
      second = std::exchange(fastest, recent_[i]);
    else
      second = std::min(second, recent_[i]);
  }
  std::size_t steps = 1;
  for (; second > kUsualStep * budget_; second /= kUsualStep) ++steps;
  return steps;
}

void DrawGovernor::change(std::size_t level) {
  const bool up = level < level_;
  if (!up && trying_) pause_ = moved_ < pause_ ? std::min(2.0 * pause_, kLongestPause) : kFirstPause;
  trying_ = up;
  level_ = level;
  count_ = 0;
  moved_ = 0.0;
}

void DrawGovernor::addFrame(const DrawEffort& effort, double seconds) {
  if (effort != whileMoving()) return;
  recent_[count_++ % recent_.size()] = seconds;
  moved_ += std::min(seconds, kLongestMotion);
  if (isTooSlow() && level_ + 1 < efforts_.size()) return change(std::min(level_ + stepsDown(), efforts_.size() - 1));
  const bool easy = count_ >= recent_.size() && slowerThan(kEasyShare * budget_) <= 1;
  if (easy && level_ > 0 && moved_ >= pause_) change(level_ - 1);
}

}  // namespace client
