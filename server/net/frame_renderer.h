#pragma once
// Exact pictures of viewers' views, rendered on a thread of its own with its own GL context (DESIGN section 6, step 5),
// and, between them, pictures of any size that somebody asked for over HTTP. One thread for all scenes of a server:
// Mesa's llvmpipe does not bear several drawing contexts (docs/architecture.md, "One drawing context").
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
  using Done = std::function<void(base::Bytes value)>;
  using Painted = std::function<void(base::Result<base::Bytes> picture)>;

  /// Starts the thread and waits for its GL context; the error says why there is none. The scenes outlive this; below
  /// they go by their place in the list. Nothing may be asked of one without patches.
  static base::Result<std::unique_ptr<FrameRenderer>> start(const std::vector<const OpenScene*>& scenes);
  /// Drops what is queued, waits for the picture in hand.
  ~FrameRenderer();

  /// Queues one picture: tolerance 0.5 px, 2 × 2 samples a pixel, encoded like a baked face (from quality 90 on 4:4:4,
  /// else 4:2:0). A client's newer request replaces its older one, whose `done` is never called; so the queue holds one
  /// request per client. `done` is called on the renderer's thread, with no bytes when rendering failed.
  void submit(std::uint64_t client, std::size_t scene, const FrameRequest& request, Done done);
  /// Queues a picture of any size, drawn in bands: at most one frame is drawn between two of them while frames wait,
  /// and no frame waits for more than one band. False, and `done` is never called: `max_waiting` pictures wait already
  /// besides the one in hand. `done` is called on the renderer's thread.
  bool paint(std::uint64_t client, std::size_t scene, const PictureRequest& request, std::size_t max_waiting,
             Painted done);
  /// Takes the client's requests from the queues and gives up its picture in hand; their `done` may already be under
  /// way.
  void cancel(std::uint64_t client);

 private:
  FrameRenderer() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
