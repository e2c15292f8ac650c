#pragma once
// Draws faces and encodes them, in one of two ways: with one GL context on a thread of this process, or with a context
// in each of several processes (draw_processes.h).
#include <cstdint>
#include <functional>
#include <memory>

#include "base/error.h"
#include "base/image.h"
#include "repository/sampling/key.h"
#include "server/bake/draw_thread.h"
#include "server/bake/face_encoder.h"

namespace server {

class FaceMaker {
 public:
  /// Called from any thread, for the faces of all jobs in any order.
  using OnFace = std::function<void(std::uint64_t sequence, const repository::FaceKey&, EncodedFace)>;
  /// Called once at least when something has failed, from any thread; faces may be missing then.
  using OnError = std::function<void(const base::Error&)>;

  virtual ~FaceMaker() = default;  ///< finishes the jobs that were submitted
  /// Blocks while enough jobs are waiting. A caller that holds back the next job until earlier faces have come never
  /// waits in vain.
  virtual void submit(DrawJob job) = 0;
  /// Returns when all faces are encoded and delivered. Nothing may be submitted after it.
  virtual void finish() = 0;
};

using Encode = std::function<base::Result<EncodedFace>(const base::Image& rgba, const FaceCoding& coding)>;

/// A DrawThread draws, and `threads` threads encode.
std::unique_ptr<FaceMaker> makeLocalFaceMaker(const FaceWork& work, unsigned threads, FaceMaker::OnFace on_face,
                                              FaceMaker::OnError on_error, Encode encode = encodeFace);

}  // namespace server
