#pragma once
// The viewer without a window: session, decoder and renderer put together; the same for GLFW, headless and (later) the browser.
#include <memory>
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "client/decode.h"
#include "client/render/lumigraph.h"
#include "client/session.h"
#include "lod/method.h"

namespace client {

struct ViewerOptions {
  SessionOptions session;
  LumigraphOptions lumigraph;
  lod::Method method = lod::Method::kLumigraph;       ///< kLumigraph or kPatches (same client, images off)
  std::uint64_t gpu_budget_bytes = 512'000'000;
  double upload_milliseconds = 4.0;                   ///< decoded data uploaded per frame at most (0: no limit)
};

struct ViewerStats {
  SessionStats session;
  LumigraphStats lumigraph;
  float error_px = 0.0F;
  bool complete = false;                              ///< the server sent all for this view and all of it is decoded, uploaded and faded in
};

/// Needs a current GL context from first draw() on.
class Viewer {
 public:
  Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~Viewer();
  Session& session();
  /// Draws the view into the bound framebuffer with what is here now. Never waits for network or decoder. `now` in seconds.
  base::Result<void> draw(const base::ViewCamera& camera, double now);
  ViewerStats stats() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace client
