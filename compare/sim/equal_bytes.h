#pragma once
// Methods at equal bytes: what one method shows for the bytes of another.
#include <optional>
#include <string>
#include <vector>

#include "compare/sim/play.h"

namespace compare {

struct BytesDifference {
  std::string method;
  double db = 0.0;          ///< mean over the moving frames of the reference's PSNR minus the method's
  double confidence = 0.0;  ///< half the width of its 95 % confidence interval (Student's t over the frames)
};

/// Compares the runs of one scene, path and link with `reference`, one of them: for each other method with several
/// knobs whose bytes enclose the reference's, its PSNR is interpolated, frame by frame, over the logarithm of the
/// bytes.
std::vector<BytesDifference> differencesAtBytesOf(const PlayedRun& reference,
                                                  const std::vector<const PlayedRun*>& runs);

}  // namespace compare
