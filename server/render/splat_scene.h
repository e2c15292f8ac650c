#pragma once
// Pictures of a scene's splats on the server (Rusinkiewicz and Levoy 2000).
#include <cstdint>
#include <memory>
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/draw/splats.h"
#include "lod/qsplat/splat_file.h"

namespace server {

/// The splats of a scene in `directory`. kNotFound where it was built without them, and the message says how to.
base::Result<lod::qsplat::SplatFile> openSplats(const std::string& directory, const base::Scene& scene);

struct SplatOptions {
  lod::draw::SplatKernel kernel = lod::draw::SplatKernel::kCircle;
  float cutoff_px = 1.0F;       ///< largest projected diameter of an inner node that is drawn, pixels; 0: leaves only
  int supersampling = 1;        ///< n × n samples a pixel, 1 … 8; box-filtered
  bool cull_back_faces = true;  ///< right for closed surfaces
  /// Largest render target in samples; a picture that needs more is drawn in tiles.
  std::uint64_t max_target_samples = std::uint64_t{1} << 24;
};

struct SplatPicture {
  base::Image rgba;  ///< alpha: 255 where all samples of the pixel saw the model, 0 where none did
  std::uint64_t splats = 0;
  std::uint64_t nodes = 0;   ///< visited
  std::uint64_t blocks = 0;  ///< of the file that were looked into, each counted once since the renderer was made
  std::uint64_t bytes = 0;   ///< these blocks have in the file
};

/// Draws a scene's qsplat.lgq. Needs a GL context that is current, from create() to the destructor; one thread, though
/// the tree is traversed on all cores.
class SplatScene {
 public:
  /// `file` must outlive it.
  static base::Result<std::unique_ptr<SplatScene>> create(const base::Scene& scene, const lod::qsplat::SplatFile& file);
  ~SplatScene();

  /// As SceneRenderer::render. A damaged file is an error that says where; nothing of it is drawn.
  base::Result<SplatPicture> render(const base::Camera& camera, const SplatOptions& options);

  /// The root's: scene-local.
  const base::Sphere& bounds() const;

 private:
  SplatScene() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
