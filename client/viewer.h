#pragma once
// The viewer without a window: session, decoder and renderer put together; the same for GLFW, headless and (later) the
// browser.
#include <memory>
#include <optional>
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
  lod::Method method = lod::Method::kLumigraph;  ///< kLumigraph or kPatches (same client, images off)
  std::uint64_t gpu_budget_bytes = 512'000'000;
  double upload_milliseconds =
      4.0;  ///< decoded data uploaded per frame at most, at an assumed 2 MB a millisecond (0: no limit)
};

struct ViewerStats {
  SessionStats session;
  LumigraphStats lumigraph;
  float error_px = 0.0F;
  bool complete = false;  ///< the server sent all for this view and all of it is decoded, uploaded and faded in
  bool busy = false;      ///< another draw at the same view would look different, with no byte more from the server
  bool exact = false;     ///< the server's picture of the very view drawn last is among the images
  std::uint32_t images_requested = 0;  ///< images of use in this view that are here but not on the GPU yet
  std::uint32_t broken = 0;            ///< images and groups whose bytes could not be decoded
  std::string last_fault;              ///< what was wrong with the latest of them
};

/// Needs a current GL context from first draw() on.
class Viewer {
 public:
  Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~Viewer();
  Session& session();
  const Session& session() const;
  const ViewerOptions& options() const;
  /// kLumigraph or kPatches, from the next view on.
  void setMethod(lod::Method method);
  /// Takes in what arrived and uploads what was decoded, within the frame's share; draws nothing. True while there is
  /// more of it to do (being decoded, or left for the next call). For callers that wait for a picture; draw() does it
  /// by itself.
  base::Result<bool> update(const base::ViewCamera& camera, double now);
  /// Draws the view into the bound framebuffer with what is here now. Never waits for network or decoder. `now` in
  /// seconds.
  base::Result<void> draw(const base::ViewCamera& camera, double now);
  /// The world point of the drawn surface at (x, y), pixels from the upper left corner; nullopt over background. Waits
  /// for the GPU.
  std::optional<glm::dvec3> surfaceAt(const base::ViewCamera& camera, double x, double y);
  ViewerStats stats() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace client
