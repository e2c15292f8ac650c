#pragma once
// Draws pictures of a scene's points and umbrellas on the server (Dey and Hudson 2002).
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/draw/umbrellas.h"
#include "lod/pmr/stream.h"
#include "server/render/tiled_picture.h"

namespace server {

struct UmbrellaOptions : SampleOptions {
  float tolerance = 1.0F;  ///< umbrellas of the level that is drawn have about this many pixels; above 0
};

struct UmbrellaPicture {
  base::Image rgba;  ///< as TiledPicture::draw() returns it
  std::uint64_t points = 0;
  std::uint64_t triangles = 0;
};

/// Draws a scene's pmr.lgm. Needs a GL context that is current from create() to the destructor, on one thread.
class UmbrellaScene {
 public:
  /// Opens the file of the scene in `directory`. Errors name it: kNotFound if the scene was built without (the message
  /// says how to), and those of reading it.
  static base::Result<std::unique_ptr<UmbrellaScene>> create(const std::string& directory, const base::Scene& scene);

  /// A damaged file is an error that names it; nothing is drawn then.
  base::Result<UmbrellaPicture> render(const base::Camera& camera, const UmbrellaOptions& options);

  /// Returns a sphere around all points, scene-local.
  const base::Sphere& bounds() const { return stream_.header()->bounds; }

 private:
  UmbrellaScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file, const base::Light& light);
  /// `request`: with the tile.
  base::Result<void> drawTile(const lod::pmr::TraverseRequest& request, const SampleTarget& target, int samples,
                              UmbrellaPicture& picture);

  const std::string path_;
  lod::pmr::Stream stream_;
  std::vector<lod::pmr::DrawnLeaf> leaves_;
  lod::draw::Shading shading_;
  std::unique_ptr<lod::draw::UmbrellaRenderer> renderer_;
  std::unique_ptr<TiledPicture> tiles_;
};

}  // namespace server
