#pragma once
// Writes the figures of a comparison as results.csv, charts and one HTML page.
#include <string>
#include <vector>

#include "base/error.h"
#include "compare/accuracy.h"

namespace compare {

/// One frame of one run.
struct FrameResult {
  int frame = 0;
  double seconds = 0.0;     ///< since the client connected, when the frame was drawn
  double draw_ms = 0.0;     ///< client's drawing alone
  std::uint64_t bytes = 0;  ///< received so far
  std::uint64_t bytes_images = 0, bytes_patches = 0, bytes_frames = 0;
  std::uint64_t triangles = 0;  ///< or splats
  std::uint32_t images = 0;     ///< blended in this frame
  bool complete = false;        ///< everything that the server has for this view had arrived
  Accuracy accuracy;
};

/// One method with one setting along the whole path.
struct RunResult {
  std::string method;               ///< "lumigraph", "lumigraph+frames", "proxy", "patches", "qsplat circle"
  double patch_tolerance_px = 0.0;  ///< the cut-off of a qsplat run
  std::vector<FrameResult> frames;

  std::string name() const;
  double meanPsnr() const;
  double meanSsim() const;
  std::uint64_t totalBytes() const;
  double medianDrawMs() const;
};

struct ReportContext {
  std::string scene, machine, commit, renderer;
  int width = 0, height = 0;
  std::string link;  ///< e.g. "20 Mbit/s, 30 ms", or "loopback"
};

/// PSNR of `runs` (one method at several settings) at `bytes`, interpolated over log(bytes) between the two runs around
/// it; beyond the ends the nearest run's figure.
double psnrAtBytes(const std::vector<const RunResult*>& runs, double bytes);

/// Writes results.csv, accuracy_bytes.svg, accuracy_frames.svg, bytes_frames.svg and index.html into `directory` (made
/// when absent).
base::Result<void> writeReport(const std::string& directory, const ReportContext& context,
                               const std::vector<RunResult>& runs);

}  // namespace compare
