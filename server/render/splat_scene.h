#pragma once
// Draws pictures of a scene's splats on the server (Rusinkiewicz and Levoy 2000).
#include <cstdint>
#include <memory>
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/draw/splats.h"
#include "lod/qsplat/splat_file.h"
#include "lod/qsplat/traverse.h"
#include "server/render/tiled_picture.h"

namespace server {

/// Opens the splats of the scene in `directory`. kNotFound if it was built without them; the message says how to.
base::Result<lod::qsplat::SplatFile> openSplats(const std::string& directory, const base::Scene& scene);

struct SplatOptions : SampleOptions {
  lod::draw::SplatKernel kernel = lod::draw::SplatKernel::kCircle;
  float cutoff_px = 1.0F;       ///< limit for the projected diameter of inner nodes, pixels; 0: leaves only
  bool cull_back_faces = true;  ///< right for closed surfaces
};

struct SplatPicture {
  base::Image rgba;  ///< as TiledPicture::draw() returns it
  std::uint64_t splats = 0;
  std::uint64_t nodes = 0;   ///< visited
  std::uint64_t blocks = 0;  ///< blocks of the file that any picture used since create()
  std::uint64_t bytes = 0;   ///< length of these blocks in the file
};

/// Draws a scene's qsplat.lgq. Needs a GL context that is current from create() to the destructor, on one thread,
/// though the tree is traversed on all cores.
class SplatScene {
 public:
  /// `file` must outlive it.
  static base::Result<std::unique_ptr<SplatScene>> create(const base::Scene& scene, const lod::qsplat::SplatFile& file);

  /// Draws a picture as SceneRenderer::render does. A damaged file is an error that names the place; nothing is drawn
  /// then.
  base::Result<SplatPicture> render(const base::Camera& camera, const SplatOptions& options);

  /// Returns the root's sphere, scene-local.
  const base::Sphere& bounds() const { return blocks_->header().root; }

 private:
  SplatScene(std::unique_ptr<lod::qsplat::FileBlocks> blocks, const base::Light& light);
  base::Result<lod::qsplat::Traversal> splatsFor(const base::Camera& camera, const SplatOptions& options);
  base::Result<void> drawTile(const base::Camera& camera, const SplatOptions& options, const SampleTarget& target,
                              SplatPicture& picture);
  void countBlocks(SplatPicture& picture) const;

  std::unique_ptr<lod::qsplat::FileBlocks> blocks_;
  std::uint32_t frame_ = 0;
  std::unique_ptr<lod::draw::SplatRenderer> renderer_;
  lod::draw::Shading shading_;
  std::unique_ptr<TiledPicture> tiles_;
};

}  // namespace server
