#pragma once
// Keeps the work for pictures of a view at rest to one part of the time while its data arrive (docs/decisions/
// draw-less-while-loading.md): a page has one thread for pictures, link and decoding, and a frame of two million
// triangles takes a second on some machines.
#include <algorithm>

namespace client {

class DutyCycle {
 public:
  static constexpr unsigned kRest = 7;  ///< rest for each part of work; a choice

  /// The last work, on so many things, took from `begin` to `end`, seconds from any zero.
  void record(double begin, double end, double amount = 1.0) {
    end_ = end;
    seconds_ = end - begin;
    amount_ = amount;
  }
  /// Whether the last work was so long ago that the next one, on so many things, may come before all data are here.
  /// More things than the last time are taken to need more time, by their number.
  bool hasRested(double now, double amount = 1.0) const {
    const double growth = std::max(amount / std::max(amount_, 1.0), 1.0);
    return now - end_ >= kRest * seconds_ * growth;
  }

 private:
  double end_ = -1e300;
  double seconds_ = 0.0;
  double amount_ = 1.0;
};

}  // namespace client
