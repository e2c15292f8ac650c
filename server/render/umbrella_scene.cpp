#include "server/render/umbrella_scene.h"

#include <utility>

#include "server/render/streamed_scene.h"

namespace server {
namespace {

// A point's square reaches about a pixel beyond its centre, and some drivers discard points whose centre lies outside
// the target.
constexpr int kTileBorder = 1;

}  // namespace

UmbrellaScene::UmbrellaScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file,
                             const base::Light& light)
    : path_(std::move(path)),
      stream_(file, wholeFile<lod::pmr::StreamOptions>()),
      shading_{light.mode == base::LightMode::kUnlit, light.direction} {}

base::Result<std::unique_ptr<UmbrellaScene>> UmbrellaScene::create(const std::string& directory,
                                                                   const base::Scene& scene) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, openStreamedFile(directory, scene, base::kUmbrellaMethod));
  std::unique_ptr<UmbrellaScene> made(new UmbrellaScene(file.path, file.bytes, scene.light));
  LUMIGRID_TRY(checkStream(made->stream_, file.path));
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::UmbrellaRenderer::create(kStreamedGpuBytes));
  LUMIGRID_ASSIGN_OR_RETURN(made->tiles_, TiledPicture::create());
  return made;
}

base::Result<void> UmbrellaScene::drawTile(const lod::pmr::TraverseRequest& request, const SampleTarget& target,
                                           int samples, UmbrellaPicture& picture) {
  stream_.update(request, leaves_);
  LUMIGRID_TRY(checkStream(stream_, path_));
  lod::draw::UmbrellaView view;
  view.camera = *request.tile;
  view.shading = shading_;
  view.oriented = stream_.header()->oriented;
  LUMIGRID_ASSIGN_OR_RETURN(const auto count, renderer_->draw(leaves_, view,
                                                              {target.framebuffer(), view.camera.width * samples,
                                                               view.camera.height * samples}));
  picture.points += count.points;
  picture.triangles += count.triangles;
  return {};
}

base::Result<UmbrellaPicture> UmbrellaScene::render(const base::Camera& camera, const UmbrellaOptions& options) {
  LUMIGRID_TRY(checkTolerance(options.tolerance));
  UmbrellaPicture picture;
  // A leaf that lies in several tiles has the same level in all of them.
  lod::pmr::TraverseRequest request;
  request.camera = camera;
  request.tolerance = options.tolerance;
  LUMIGRID_ASSIGN_OR_RETURN(picture.rgba, tiles_->draw(
                                              camera, options,
                                              [&](const base::Camera& tile, const SampleTarget& target) {
                                                request.tile = tile;
                                                return drawTile(request, target, options.supersampling, picture);
                                              },
                                              kTileBorder));
  return picture;
}

}  // namespace server
