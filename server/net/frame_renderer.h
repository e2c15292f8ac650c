#pragma once
// Renders exact frames of viewers' views, and between them pictures of any size that were requested over HTTP, on a
// thread of its own with its own GL context. All scenes of a server share that thread, since Mesa's llvmpipe crashes
// with several drawing contexts at once (docs/decisions/software-gl-processes.md).
//
// Large frames are drawn in bands, and the next band is that of the client for whom fewest pixels were drawn so far:
// who asks for large frames waits for those who ask for small ones, and many clients of one address are served as a few
// would be. Frames are encoded on other threads.
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/error.h"
#include "server/net/drawn_frames.h"
#include "server/net/frame_painter.h"
#include "server/net/picture.h"
#include "server/render/scene_renderer.h"
#include "server/scene/open_scene.h"
#include "server/session/fair_queue.h"
#include "server/session/fair_shares.h"
#include "server/session/session.h"

namespace server {

/// How many pictures may wait.
struct PictureLimits {
  std::size_t waiting = 4;         ///< of all, besides the one being drawn
  std::size_t of_one_address = 2;  ///< with the one being drawn
};

/// Its end drops queued requests and waits for the current band.
class FrameRenderer {
 public:
  using OnFrame = std::function<void(protocol::EncodedFrame frame)>;
  using OnPicture = std::function<void(base::Result<base::Bytes> picture)>;
  using ScenePointer = std::shared_ptr<const OpenScene>;

  /// Starts the thread and waits for its GL context; the error says why there is none. The scenes here are prepared at
  /// once, those of addScene() when they are first asked for.
  static base::Result<std::unique_ptr<FrameRenderer>> start(const std::vector<ScenePointer>& scenes);

  /// Queues one frame (exactFrameOptions) of a scene with patches, encoded by encodeFrame(), for a client of this
  /// `address`, a limitKey(). A view that was drawn a short while ago, for whatever client and quality, is not drawn
  /// again. A client's newer request replaces its older one, whose `done` is never called; so the queue holds one
  /// request per client. `done` is called on an encoder's thread, with no bytes when rendering failed.
  void requestFrame(std::uint64_t client, const std::string& address, ScenePointer scene, const FrameRequest& request,
                    OnFrame done);
  /// Queues a picture of any size, drawn in bands, one between two bands of frames while frames wait. Returns false,
  /// and never calls `done`, when as many wait as the limits allow. `done` is called on the renderer's thread.
  bool requestPicture(std::uint64_t client, const std::string& address, ScenePointer scene,
                      const PictureRequest& request, const PictureLimits& limits, OnPicture done);
  /// Makes a scene known that is asked for from here on. The thread that may change the scene calls it.
  void addScene(const ScenePointer& scene);
  /// Draws the scene by another light: each frame, and each picture that is begun, that is asked for from here on.
  void setLight(const ScenePointer& scene, const base::Light& light);
  /// Removes the client's requests from the queues and abandons those that are being drawn. A `done` that runs already
  /// still completes.
  void cancel(std::uint64_t client);
  /// Numbers for metrics: requests that wait, and views that were found drawn, or not, since the start. Any thread.
  struct Counts {
    std::size_t waiting_frames = 0, waiting_pictures = 0;
    std::uint64_t found = 0, not_found = 0;
  };
  Counts counts();
  /// Lets go of the scene once its last request is done.
  void forgetScene(const ScenePointer& scene);

 private:
  FrameRenderer();
  struct FrameJob {
    std::uint64_t client = 0;
    std::string address;
    std::uint64_t number = 0;  // in the order of the requests
    ScenePointer scene;
    FrameRequest request;
    OnFrame done;
    std::unique_ptr<FramePainter> painter = nullptr;  // used by the thread alone; null: not begun
  };
  struct PictureJob {
    std::uint64_t client = 0;
    std::string address;
    ScenePointer scene;
    PictureRequest request;
    OnPicture done;
    std::unique_ptr<PicturePainter> painter = nullptr;  // used by the thread alone; null: not begun
  };
  struct Drawn {
    ScenePointer scene;
    base::Scene described;  // a copy, since the scene's appearance may change
    std::unique_ptr<SceneRenderer> renderer = nullptr;
  };

  void runThread(const std::stop_token& stop, const std::vector<ScenePointer>& scenes,
                 std::promise<base::Result<void>> started);
  bool waitForWork(const std::stop_token& stop);
  std::list<FrameJob>::iterator nextFrame();
  base::Result<SceneRenderer*> rendererOf(const ScenePointer& scene);
  void takeUpScenes();
  bool isAskedFor(const ScenePointer& scene) const;
  bool isBeingDrawn(const ScenePointer& scene) const;
  bool canForget() const;
  void drop(std::uint64_t client);
  void drawFrameBand();
  base::Result<bool> drawNextBand(FrameJob& job);
  struct Encoding;
  void encode(FrameJob job, std::shared_ptr<const base::Image> picture);
  void drawPictureBand();
  base::Result<bool> drawNextBand(PictureJob& job);

  // Used by the thread alone.
  std::map<const OpenScene*, Drawn> renderers_;
  DrawnFrames drawn_;
  std::optional<FrameJob> current_frame_;
  std::optional<PictureJob> current_picture_;

  std::atomic<std::uint64_t> found_ = 0, not_found_ = 0;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::vector<Drawn> added_;                    // not yet taken up
  std::map<ScenePointer, base::Light> lights_;  // likewise
  std::vector<ScenePointer> forgotten_;         // likewise
  std::list<FrameJob> frames_;                  // one per client at most
  FairShares shares_;                           // of the pixels
  std::uint64_t next_number_ = 0;
  std::size_t begun_ = 0;                                       // frames that are drawn in part
  std::size_t large_encoding_ = 0;                              // large pictures that are being encoded, or wait for it
  std::uint64_t encoding_bytes_ = 0;                            // of pictures that are being encoded
  std::deque<PictureJob> pictures_;                             // oldest first
  std::optional<std::uint64_t> frame_client_, picture_client_;  // of the current jobs
  std::string picture_address_;
  bool frame_cancelled_ = false, picture_cancelled_ = false;  // nobody wants the current job any more
  FairQueue encoders_, large_encoders_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace server
