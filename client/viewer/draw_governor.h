#pragma once
// Decides how much the pictures of a moving view may cost, so that they come as often as is wanted: by images, samples
// a pixel, and pixels. It has no GL and no clock of its own.
#include <array>
#include <cstddef>
#include <vector>

#include "client/render/lumigraph.h"

namespace client {

/// A picture's samples, pixels and images. docs/decisions/moving-effort.md has the cost and the accuracy of each.
struct DrawEffort {
  int samples = 1;           ///< a pixel
  float scale = 1.0F;        ///< width and height that are drawn, over those that are shown; at most 1
  int points = kMaxBlended;  ///< whose images each patch is blended from at most
  int pictures = 1;          ///< whose mean is shown, each shifted by a part of a pixel

  friend bool operator==(const DrawEffort&, const DrawEffort&) = default;
};

class DrawGovernor {
 public:
  /// Below 30 pictures a second motion looks jerky. A choice.
  static constexpr double kUsualRate = 30.0;
  /// The first wait with less effort, in seconds of motion, before more is tried again; each failure doubles it.
  static constexpr double kFirstPause = 5.0;

  /// `most_samples`: samples a pixel that are wanted, 1 or more. `slow`: begin with one sample, as for GL in software.
  /// `rate`: pictures a second that are wanted; 0: all effort, however long it takes.
  DrawGovernor(int most_samples, bool slow, double rate = kUsualRate);

  /// Returns the efforts to choose from, the largest first; each costs less than the one before.
  static std::vector<DrawEffort> efforts(int most_samples);

  int mostSamples() const { return most().samples; }
  const DrawEffort& most() const { return efforts_.front(); }
  /// Returns the effort for the next picture of a moving view.
  const DrawEffort& whileMoving() const { return efforts_[level_]; }
  /// Whether that is all effort.
  bool isAtMost() const { return level_ == 0; }
  /// Tells that a picture of a moving view with this effort took so many seconds, from its start to that of the next
  /// one. One slow picture, or a pause of the hand that moves the view, changes nothing.
  void addFrame(const DrawEffort& effort, double seconds);

 private:
  std::size_t slowerThan(double seconds) const;
  bool isTooSlow() const;
  std::size_t stepsDown() const;
  void change(std::size_t level);

  std::vector<DrawEffort> efforts_;
  double budget_;                   // seconds a picture
  std::size_t level_ = 0;           // of efforts_; a larger one costs less
  std::array<double, 5> recent_{};  // seconds
  std::size_t count_ = 0;           // of frames since the last change
  double moved_ = 0.0;              // seconds of motion since the last change
  double pause_ = kFirstPause;
  bool trying_ = false;  // the last change was to a larger effort
};

}  // namespace client
