#pragma once
// The gate: a summary.csv of today against one that was kept, so that no change loses accuracy, bytes or time unseen.
#include <string>
#include <vector>

#include "base/error.h"

namespace compare {

/// A figure may be worse than the baseline's by so much. A few bytes more in one piece let others come one frame
/// earlier or later, so that one path by itself moves by 0.4 dB and more where nothing is better or worse: figures
/// while the eye moves are held to `db` as means over the paths of a method. A level's time is not compared, only
/// whether it was reached: 0.02 dB move that by seconds.
struct GateLimits {
  double db = 0.1;          ///< at rest, and in the mean over the paths of a method
  double path_db = 0.3;     ///< on one path, while the eye moves
  double share = 0.02;      ///< of bytes and of times
  double seconds = 0.0334;  ///< in addition: two frames of the display, in which times are counted
  double bytes = 1024.0;    ///< in addition
};

/// Returns a line for each figure that got worse than the limits allow, and for each run that only one of the two has;
/// none when all is well. Both texts are as compare::summaryCsv writes them. kInvalidInput for a baseline that is none;
/// `name` begins the error's line.
base::Result<std::vector<std::string>> findLosses(const std::string& summary, const std::string& baseline,
                                                  const std::string& name, const GateLimits& limits = {});

}  // namespace compare
