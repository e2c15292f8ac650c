#pragma once
// Pictures of a patch hierarchy on the server: sampling faces, exact frames, ground truth.
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/draw/view_modes.h"
#include "lod/patch/format.h"
#include "lod/patch/traverse.h"

namespace server {

struct RenderOptions {
  float tolerance_px = 1.0F;  ///< 0: leaf geometry (ground truth)
  int supersampling = 1;      ///< n × n samples a pixel, 1..8; box-filtered
  /// Largest render target in samples (8 bytes each); a picture that needs more is drawn in tiles. Default:
  /// 4096 × 4096.
  std::uint64_t max_target_samples = std::uint64_t{1} << 24;
  lod::draw::ViewModes modes = {};  ///< of render() alone; tints say the patches' projected errors
};

struct RenderedPicture {
  base::Image rgba;             ///< alpha: 255 where all samples of the pixel saw the model, 0 where none did
  std::uint64_t triangles = 0;  ///< drawn
};

/// Draws a scene's patches through its own GPU cache of patches. Needs a GL context that is current, from create() to
/// the destructor; one thread. Several renderers on several threads, each with its own context, may share a PatchFile.
/// An error while drawing or reading back drops all pictures that are still on their way: `take` is not called for them
/// any more.
class SceneRenderer {
 public:
  /// `gpu_budget_bytes`: uploaded patches are kept up to this, least recently used first out; a cut that needs more is
  /// drawn in batches. `patches` must outlive the renderer.
  static base::Result<std::unique_ptr<SceneRenderer>> create(const base::Scene& scene,
                                                             const lod::patch::PatchFile& patches,
                                                             std::uint64_t gpu_budget_bytes = std::uint64_t{2} << 30);
  ~SceneRenderer();

  /// Any camera (base::Camera::clipFromScene), parallel projections included; each side 1..32768 pixels. Background is
  /// transparent black. Back faces are drawn. Sizes beyond the GL limit are drawn in tiles. Delivers what renderMany
  /// left on its way first.
  base::Result<RenderedPicture> render(const base::Camera& camera, const RenderOptions& options);

  /// Several cameras with one cut (the six faces of a sampling point): selected once without frustum, at the finest
  /// need of them, then culled for each; all have the same `eye`. Read back asynchronously through pixel buffers:
  /// `take(i, rgba)` is called for each camera in order, while later ones are still being drawn; also for those of the
  /// previous call. finish() flushes.
  base::Result<void> renderMany(const std::vector<base::Camera>& cameras, const RenderOptions& options,
                                const std::function<void(std::size_t camera, RenderedPicture)>& take);
  base::Result<void> finish();

  float sceneRadius() const;
  glm::vec3 sceneCenter() const;

 private:
  SceneRenderer() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
