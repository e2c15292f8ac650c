#pragma once
// Renders exact frames of viewers' views, and between them pictures of any size that were requested over HTTP, on a
// thread of its own with its own GL context. All scenes of a server share that thread, since Mesa's llvmpipe crashes
// with several drawing contexts at once (docs/decisions/software-gl-processes.md).
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "base/error.h"
#include "server/net/drawn_frames.h"
#include "server/net/open_scene.h"
#include "server/net/picture.h"
#include "server/render/scene_renderer.h"
#include "server/session/session.h"

namespace server {

/// Its end drops queued requests and waits for the current band or frame.
class FrameRenderer {
 public:
  using OnFrame = std::function<void(base::Bytes value)>;
  using OnPicture = std::function<void(base::Result<base::Bytes> picture)>;

  /// Starts the thread and waits for its GL context; the error says why there is none. The scenes outlive this; the
  /// parameter `scene` below is a position in the list, of a scene with patches.
  static base::Result<std::unique_ptr<FrameRenderer>> start(const std::vector<const OpenScene*>& scenes);

  /// Queues one frame (exactFrameOptions), encoded by encodeFrame(). A view that was drawn a short while ago, for
  /// whatever client and quality, is not drawn again. A client's newer request replaces its older one, whose `done` is
  /// never called; so the queue holds one request per client. `done` is called on the renderer's thread, with no bytes
  /// when rendering failed.
  void requestFrame(std::uint64_t client, std::size_t scene, const FrameRequest& request, OnFrame done);
  /// Queues a picture of any size, drawn in bands: at most one frame is drawn between two bands while frames wait, and
  /// no frame waits for more than one band. Returns false, and never calls `done`, when `max_waiting` pictures wait
  /// already besides the one being drawn. `done` is called on the renderer's thread.
  bool requestPicture(std::uint64_t client, std::size_t scene, const PictureRequest& request, std::size_t max_waiting,
                      OnPicture done);
  /// Draws the scene by another light: each frame, and each picture that is begun, that is asked for from here on.
  void setLight(std::size_t scene, const base::Light& light);
  /// Removes the client's requests from the queues and abandons its picture if that is being drawn. A `done` that runs
  /// already still completes.
  void cancel(std::uint64_t client);

 private:
  explicit FrameRenderer(const std::vector<const OpenScene*>& scenes);
  struct FrameJob {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    FrameRequest request;
    OnFrame done;
  };
  struct PictureJob {
    std::uint64_t client = 0;
    std::size_t scene = 0;
    PictureRequest request;
    OnPicture done;
    std::unique_ptr<PicturePainter> painter;  // used by the thread alone; null: not begun
  };

  void runThread(const std::stop_token& stop, std::promise<base::Result<void>> started);
  bool waitForWork(const std::stop_token& stop, std::optional<FrameJob>& frame);
  base::Result<void> makeRenderers();
  void takeUpLights();
  base::Bytes renderFrame(const FrameJob& job);
  base::Result<base::Bytes> encodedFrame(const FrameJob& job);
  void drawPictureBand();
  base::Result<bool> drawNextBand(PictureJob& job) const;

  const std::vector<const OpenScene*> scenes_;
  std::vector<std::unique_ptr<SceneRenderer>> renderers_;  // used by the thread alone; parallel to `scenes_`
  DrawnFrames drawn_;                                      // used by the thread alone
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::map<std::size_t, base::Light> lights_;    // by scene: not yet taken up
  std::deque<FrameJob> queue_;                   // one per client at most, oldest first
  std::deque<PictureJob> pictures_;              // oldest first
  std::optional<std::uint64_t> current_client_;  // the client of current_picture_
  bool current_cancelled_ = false;               // nobody wants current_picture_ any more
  std::optional<PictureJob> current_picture_;    // used by the thread alone
  std::jthread thread_;                          // last: it uses the others
};

}  // namespace server
