#pragma once
// Runs the thin client without a window along a recorded camera path, and writes a picture and a line of figures for
// each frame (docs/formats/headless.md). Used by `lumigrid-view --headless` and by compare.
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

/// A drawn frame of the path.
struct HeadlessFrame {
  std::size_t index = 0;
  base::ViewCamera camera;
  double seconds = 0.0;         ///< from the server's Welcome to the moment the picture was drawn
  double settle_seconds = 0.0;  ///< part of `seconds` spent waiting for this view to be complete; 0 with realtime_fps
  double draw_ms = 0.0;         ///< duration of the last draw, GPU included
  ViewerStats stats;
  LinkCounts link;    ///< requests to a published scene
  base::Image image;  ///< RGBA; alpha 0 where background (unless the background is a colour)
};

struct HeadlessOptions {
  std::string url;
  std::vector<base::ViewCamera> path;  ///< world coordinates; each frame has its own size. Empty: the first view alone
  std::string view;                    ///< without a path: permalink of the view; empty: that of the scene
  int width = 1280, height = 720;      ///< without a path: of the picture, pixels
  ViewerOptions viewer;
  bool method_is_default =
      false;  ///< the user named no method: where the scene lacks the data for ViewerOptions::method, another is used
  StreamedOptions streamed;      ///< for methods for which isStreamed()
  double settle_seconds = 10.0;  ///< longest wait for each view to be complete; nothing fades in then
  double realtime_fps = 0.0;     ///< > 0: draws frames at this rate without waiting for anything
  LinkLimit link;
  HostAccess access;
  double connect_timeout = 10.0;  ///< seconds
  unsigned decoder_threads = 2;
  bool scene_background = false;  ///< pictures have the scene's background, where it has one
  std::string out_dir;            ///< folder for PNG files and frames.jsonl; empty: none are written
  std::function<void(const HeadlessFrame&)> on_frame;
  std::function<bool()> cancelled;  ///< polled; true ends the run with kCancelled
};

struct HeadlessSummary {
  std::size_t frames = 0;
  std::size_t incomplete = 0;  ///< frames that were drawn before their view was complete
  double seconds = 0.0;
  Method method = Method::kLumigraph;  ///< the method that was drawn
  std::string renderer;                ///< GL_RENDERER
  SessionStats session;
  std::uint32_t broken = 0;
  std::string last_fault;
};

/// Makes a GL context of its own, which is current only during the call. Errors: no GL, no server within
/// connect_timeout, a refusal, a connection lost for longer than connect_timeout, disk.
base::Result<HeadlessSummary> runHeadless(const HeadlessOptions& options);

/// Returns the line of frames.jsonl for a frame, without its newline.
std::string formatHeadlessFrame(const HeadlessFrame& frame);

}  // namespace client
