#pragma once
// Draws pictures of a scene's nodes of triangles and points on the server (Guthe et al. 2004).
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/draw/node_shadows.h"
#include "lod/hlod/shadow_options.h"
#include "lod/hlod/stream.h"
#include "server/render/tiled_picture.h"

namespace server {

using lod::hlod::Shadows;

struct HlodOptions : SampleOptions {
  float tolerance = 0.5F;  ///< the most that a node's error may be, pixels; above 0
  Shadows shadows = Shadows::kNone;
  /// The light of shadows, scene-local. Hard ones ignore its size, soft ones need one.
  lod::hlod::ShadowLight light;
  /// Pictures follow one another as a viewer moves: shadow maps reach farther than one needs, and serve the next.
  bool moves = false;
};

struct HlodPicture {
  base::Image rgba;  ///< as TiledPicture::draw() returns it
  lod::draw::NodeCount count;
};

/// Draws a scene's hlod.lgh. Needs a GL context that is current from create() to the destructor, on one thread.
class HlodScene {
 public:
  /// Opens the file of the scene in `directory`. Errors name it: kNotFound if the scene was built without (the message
  /// says how to), and those of reading it.
  static base::Result<std::unique_ptr<HlodScene>> create(const std::string& directory, const base::Scene& scene);

  /// A damaged file is an error that names it; nothing is drawn then.
  base::Result<HlodPicture> render(const base::Camera& camera, const HlodOptions& options);

  /// Returns a sphere around all geometry, scene-local.
  const base::Sphere& bounds() const { return stream_.header()->bounds; }

 private:
  HlodScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file, const base::Scene& scene);
  /// `request`: with the tile.
  base::Result<void> drawTile(const lod::hlod::TraverseRequest& request, const SampleTarget& target,
                              const HlodOptions& options, HlodPicture& picture);

  const std::string path_;
  lod::hlod::Stream stream_;
  std::vector<lod::hlod::DrawnNode> nodes_;
  lod::draw::Shading shading_;
  lod::draw::NodeShadowFinder shadow_finder_;
  lod::draw::NodeShadows shadows_;  ///< on nodes_
  std::unique_ptr<lod::draw::NodeRenderer> renderer_;
  std::unique_ptr<TiledPicture> tiles_;
};

}  // namespace server
