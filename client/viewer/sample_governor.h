#pragma once
// Decides how many samples a pixel the pictures of a moving view get: all that are wanted, and one where frame times
// ask for it. It has no GL and no clock of its own.
#include <array>
#include <cstddef>

namespace client {

class SampleGovernor {
 public:
  /// The frame time up to which samples are kept, seconds. A choice: below 30 pictures a second motion looks jerky.
  static constexpr double kBudgetSeconds = 1.0 / 30.0;
  /// The first wait with one sample, in seconds of motion, before all are tried again; each failure doubles it.
  static constexpr double kFirstPause = 10.0;

  /// `most`: samples a pixel that are wanted, 1 or more. `slow`: begin with one sample, as for GL in software.
  SampleGovernor(int most, bool slow) : most_(most), affords_most_(!slow) {}

  int most() const { return most_; }
  /// Returns the samples of the next picture of a moving view.
  int whileMoving() const { return affords_most_ ? most_ : 1; }
  /// Tells that a picture of a moving view with this many samples took so many seconds, from its start to that of the
  /// next one. One slow picture, or a pause of the hand that moves the view, changes nothing.
  void addFrame(int samples, double seconds);

 private:
  std::size_t slowerThan(double seconds) const;
  void change(bool affords_most);

  int most_;
  bool affords_most_;
  std::array<double, 5> recent_{};  // seconds
  std::size_t count_ = 0;           // of frames since the last change
  double moved_ = 0.0;              // seconds of motion since the last change
  double pause_ = kFirstPause;
};

}  // namespace client
