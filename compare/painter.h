#pragma once
// Pictures as the server draws them: exact frames, and the truth that all methods are judged against.
#include <memory>
#include <string>

#include "base/camera.h"
#include "base/egl/headless.h"
#include "base/error.h"
#include "base/image.h"
#include "lod/hlod/shadow_options.h"
#include "repository/cache.h"
#include "server/render/hlod_scene.h"
#include "server/render/scene_renderer.h"
#include "server/scene/open_scene.h"

namespace compare {

/// Draws a scene in a GL context of its own, on the thread of its caller. The context that is current before a call is
/// current after it.
class Painter {
 public:
  /// `scene` and `gl`, the context that is current, outlive it.
  static base::Result<std::unique_ptr<Painter>> create(const server::OpenScene& scene, base::HeadlessContext& gl);
  ~Painter();
  Painter(const Painter&) = delete;
  Painter& operator=(const Painter&) = delete;

  base::Result<base::Image> paint(const base::ViewCamera& camera, const server::RenderOptions& options);
  /// Draws the leaves of the scene's hlod.lgh with shadows of its light, which is as large as the sun. n × n samples a
  /// pixel.
  base::Result<base::Image> paintShadows(const base::ViewCamera& camera, lod::hlod::Shadows shadows, int supersampling);
  /// Returns the view's exact picture (server::exactFrameOptions), RGBA. Pictures are kept within kExactBytes, since
  /// all methods that show pictures, with all their knobs and links, ask for views of the same path.
  base::Result<std::shared_ptr<const base::Image>> exactPicture(const base::ViewCamera& camera);
  /// Returns an exact frame as the server sends it (server::FrameRenderer).
  base::Result<protocol::EncodedFrame> exactFrame(const server::FrameRequest& request);

  /// A path of 8 seconds has 480 views, and 640 × 360 pixels take 0.9 MB.
  static constexpr std::uint64_t kExactBytes = 1'000'000'000;

 private:
  Painter(const server::OpenScene& scene, base::HeadlessContext& gl) : scene_(scene), callers_gl_(gl) {}

  const server::OpenScene& scene_;
  base::HeadlessContext& callers_gl_;
  std::unique_ptr<base::HeadlessContext> gl_;
  std::unique_ptr<server::SceneRenderer> renderer_;
  std::unique_ptr<server::HlodScene> nodes_;  ///< null until it is needed
  repository::LruCache<std::string, std::shared_ptr<const base::Image>> exact_{kExactBytes};
};

/// All numbers of a camera as text, equal for equal views.
std::string textOf(const base::ViewCamera& camera);

/// The truth of single views: leaf geometry, supersampled, kept as PNG files under a hash of all that it depends on.
class Truth {
 public:
  /// `directory` is made when the first picture is. `shadows`: those that its pictures have.
  Truth(const server::OpenScene& scene, std::string directory, int supersampling,
        lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone);
  /// Returns the picture that is kept, or draws and keeps it.
  base::Result<base::Image> picture(const base::ViewCamera& camera, Painter& painter) const;
  /// Returns the picture that is kept. kNotFound when there is none.
  base::Result<base::Image> keptPicture(const base::ViewCamera& camera) const;

 private:
  std::string fileOf(const base::ViewCamera& camera) const;
  std::string directory_, identity_;
  int samples_;
  lod::hlod::Shadows shadows_;
};

}  // namespace compare
