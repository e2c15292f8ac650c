#pragma once
// Renders exact frames of viewers' views, and between them pictures of any size that were requested over HTTP, on a
// thread of its own with its own GL context. All scenes of a server share that thread, since Mesa's llvmpipe crashes
// with several drawing contexts at once (docs/decisions/software-gl-processes.md).
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "base/error.h"
#include "server/net/open_scene.h"
#include "server/net/picture.h"
#include "server/session/session.h"

namespace server {

class FrameRenderer {
 public:
  using OnFrame = std::function<void(base::Bytes value)>;
  using OnPicture = std::function<void(base::Result<base::Bytes> picture)>;

  /// Starts the thread and waits for its GL context; the error says why there is none. The scenes outlive this; the
  /// parameter `scene` below is a position in the list, of a scene with patches.
  static base::Result<std::unique_ptr<FrameRenderer>> start(const std::vector<const OpenScene*>& scenes);
  /// Drops queued requests and waits for the current band or frame.
  ~FrameRenderer();

  /// Queues one frame: tolerance 0.25 px, 2 × 2 samples a pixel, encoded like a baked face (from quality 90 on 4:4:4,
  /// else 4:2:0). A client's newer request replaces its older one, whose `done` is never called; so the queue holds one
  /// request per client. `done` is called on the renderer's thread, with no bytes when rendering failed.
  void requestFrame(std::uint64_t client, std::size_t scene, const FrameRequest& request, OnFrame done);
  /// Queues a picture of any size, drawn in bands: at most one frame is drawn between two bands while frames wait, and
  /// no frame waits for more than one band. Returns false, and never calls `done`, when `max_waiting` pictures wait
  /// already besides the one being drawn. `done` is called on the renderer's thread.
  bool requestPicture(std::uint64_t client, std::size_t scene, const PictureRequest& request, std::size_t max_waiting,
                      OnPicture done);
  /// Removes the client's requests from the queues and abandons its picture if that is being drawn. A `done` that runs
  /// already still completes.
  void cancel(std::uint64_t client);

 private:
  FrameRenderer() = default;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace server
