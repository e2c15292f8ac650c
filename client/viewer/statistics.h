#pragma once
// The figures of the statistics overlay, as numbers and as lines of text.
#include <string>
#include <vector>

#include "client/viewer/viewer.h"

namespace client {

struct Statistics {
  ViewerStats viewer;
  double frames_per_second = 0.0;        ///< over the last second; 0 at rest
  double frame_milliseconds = 0.0;       ///< time to draw one frame, smoothed; 0 when the platform gave no clock
  double megabits_per_second = 0.0;      ///< received, rate of the last second
  double round_trip_milliseconds = 0.0;  ///< from sending a view to the first answer; 0: not measured yet
  double hit_rate = 0.0;                 ///< share of the images used by moving views that were here already, 0 … 1
};

std::vector<StatisticsLine> statisticsLines(const Statistics& statistics);

}  // namespace client
