#pragma once
// A viewer and the session that serves it, joined without a link: settled pictures for trials, benchmarks and tests.
#include <cstdint>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "client/viewer/viewer.h"
#include "server/session/session.h"

namespace server {

/// Options under which each picture is final at once: no fades, no limit of uploads, no exact frames.
client::ViewerOptions settledOptions(client::Method method);

/// Draws in the GL context that is current in all calls, from the constructor to the destructor.
class DirectViewer {
 public:
  /// `data` outlives the viewer.
  DirectViewer(const SceneData& data, const client::ViewerOptions& options);

  /// Returns the picture of a view, RGBA, once all that the view needs has arrived. Errors: those of GL, and
  /// kUnsupported where the two never come to an end.
  base::Result<base::Image> show(const base::ViewCamera& camera);
  /// Draws a view from what is here into the framebuffer bound now. Nothing arrives for it.
  base::Result<void> redraw(const base::ViewCamera& camera);
  std::uint64_t bytesReceived() const { return viewer_.stats().session.bytes_received; }
  const client::Viewer& viewer() const { return viewer_; }

 private:
  base::Result<void> exchangeMessages();

  Session server_;
  client::Viewer viewer_;
  double now_ = 0.0;
};

}  // namespace server
