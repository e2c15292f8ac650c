#pragma once
// Keeps the work for pictures of a view at rest to one part of the time while its data arrive (docs/decisions/
// draw-less-while-loading.md): a page has one thread for pictures, link and decoding, and a frame of two million
// triangles takes a second on some machines.

namespace client {

class DutyCycle {
 public:
  static constexpr unsigned kRest = 7;  ///< rest for each part of work; a choice

  /// The last work took from `begin` to `end`, seconds from any zero.
  void record(double begin, double end) {
    end_ = end;
    seconds_ = end - begin;
  }
  /// Whether the last work was so long ago that the next one may come before all data are here.
  bool hasRested(double now) const { return now - end_ >= kRest * seconds_; }

 private:
  double end_ = -1e300;
  double seconds_ = 0.0;
};

}  // namespace client
