#pragma once
// The thin client without a window: a recorded camera path, a picture and a line of figures for each of its frames
// (docs/formats/headless.md). Used by `lumigrid-view --headless` and by compare.
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "client/native/link.h"
#include "client/viewer/viewer.h"

namespace client {

/// One frame of the path, drawn.
struct HeadlessFrame {
  std::size_t index = 0;
  base::ViewCamera camera;
  double seconds = 0.0;         ///< from the server's Welcome to the moment the picture was drawn
  double settle_seconds = 0.0;  ///< of these, spent waiting for this view to be complete; 0 with realtime_fps
  double draw_ms = 0.0;         ///< the last draw, GPU included
  ViewerStats stats;
  LinkCounts link;    ///< of a published scene
  base::Image image;  ///< RGBA; alpha 0 where background (unless the background is a colour)
};

struct HeadlessOptions {
  std::string url;
  std::vector<base::ViewCamera> path;  ///< world coordinates; each frame has its own size
  ViewerOptions viewer;
  bool method_is_default = false;  ///< nobody asked for ViewerOptions::method: where the scene lacks its data, another
  SplatOptions splats;             ///< with method kQsplat
  double settle_seconds = 10.0;    ///< wait up to this for each view to be complete; fades are off then
  double realtime_fps = 0.0;       ///< > 0: frames at this rate without waiting for anything
  LinkLimit link;
  double connect_timeout = 10.0;  ///< seconds
  unsigned decoder_threads = 2;
  std::string out_dir;  ///< PNG files and frames.jsonl go here; empty: none are written
  std::function<void(const HeadlessFrame&)> on_frame;
  std::function<bool()> cancelled;  ///< asked now and then; true ends the run with kCancelled
};

struct HeadlessSummary {
  std::size_t frames = 0;
  std::size_t incomplete = 0;  ///< frames drawn before all was there
  double seconds = 0.0;
  Method method = Method::kLumigraph;  ///< that was drawn with
  std::string renderer;                ///< GL_RENDERER
  SessionStats session;
  std::uint32_t broken = 0;
  std::string last_fault;
};

/// Makes a GL context of its own and leaves it current no longer than the call. Errors: no GL, server not there within
/// connect_timeout, server refuses, connection lost for longer than connect_timeout, disk.
base::Result<HeadlessSummary> runHeadless(const HeadlessOptions& options);

/// The line of frames.jsonl for a frame, without its newline.
std::string formatHeadlessFrame(const HeadlessFrame& frame);

}  // namespace client
