#pragma once
// Runs the methods over real sockets along one camera path and measures every frame against the truth: the leaf
// geometry, supersampled.
#include <functional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/view_defaults.h"
#include "compare/report.h"

namespace compare {

struct RunOptions {
  std::string scene;  ///< directory
  std::vector<base::ViewCamera> path;
  std::vector<std::string> methods{"lumigraph", "patches"};
  std::string report;  ///< directory for the report; truth pictures are kept there and reused
  std::vector<double> patch_tolerances{16, 8, 4, 2, 1, 0.5};  ///< pixels: settings of "patches"
  std::vector<std::string> splats{"circle", "ellipse"};       ///< kernels of "qsplat"
  std::vector<double> cutoffs{16, 8, 4, 2, 1};                ///< pixels: settings of each
  double proxy_tolerance = 8.0;                               ///< pixels; for the proxy under the images
  int points = base::ViewDefaults::kPoints;                   ///< sampling points per view
  int samples = base::ViewDefaults::kImages;                  ///< images blended per frame at most
  bool frames = true;                                         ///< also run with exact frames
  int truth_supersampling = 4;                                ///< n × n samples a pixel
  double settle_seconds = 20.0;                               ///< longest wait per frame for its data
  double realtime_fps = 0.0;      ///< above 0: frames are drawn at this rate instead, without waiting
  double bytes_per_second = 0.0;  ///< rate of the link; 0: unlimited, as the loopback is
  double latency_seconds = 0.0;
  std::uint64_t cache_bytes = 50'000'000;
  bool pictures = true;  ///< whether to write each method's pictures and differences beside the truth
};

/// `log` gets one line per step.
base::Result<std::vector<RunResult>> runComparison(const RunOptions& options,
                                                   const std::function<void(const std::string&)>& log);

/// The processor and its cores, "Intel …, 2 cores".
std::string machineName();

}  // namespace compare
