#include "server/render/hlod_scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/render/streamed_scene.h"

namespace server {
namespace {

/// By so many pixels tiles overlap: points reach as far beyond their centres, and lines beyond their ends, as a node's
/// error, half a pixel at least, and some drivers discard points whose centre lies outside the target.
int tileBorder(float tolerance) {
  constexpr float kMaxBorder = 64.0F;
  return 1 + static_cast<int>(std::ceil(std::min(tolerance, kMaxBorder)));
}

base::Result<void> checkLight(const HlodOptions& options) {
  if (options.shadows != Shadows::kSoft || options.light.size > 0.0F) return {};
  return base::Error{base::ErrorCode::kInvalidInput, "render: soft shadows need a light of some size"};
}

}  // namespace

HlodScene::HlodScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file, const base::Scene& scene)
    : path_(std::move(path)),
      stream_(file, wholeFile<lod::hlod::StreamOptions>()),
      shading_{scene.light.mode == base::LightMode::kUnlit, scene.light.direction} {}

base::Result<std::unique_ptr<HlodScene>> HlodScene::create(const std::string& directory, const base::Scene& scene) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, openStreamedFile(directory, scene, base::kHlodMethod));
  std::unique_ptr<HlodScene> made(new HlodScene(file.path, file.bytes, scene));
  LUMIGRID_TRY(checkStream(made->stream_, file.path));
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::NodeRenderer::create(kStreamedGpuBytes));
  LUMIGRID_ASSIGN_OR_RETURN(made->tiles_, TiledPicture::create());
  return made;
}

base::Result<void> HlodScene::drawTile(const lod::hlod::TraverseRequest& request, const SampleTarget& target,
                                       const HlodOptions& options, HlodPicture& picture) {
  stream_.update(request, nodes_);
  LUMIGRID_TRY(checkStream(stream_, path_));
  const bool has_shadows = options.shadows != Shadows::kNone;
  if (has_shadows) {
    lod::draw::NodeLight light{options.light, static_cast<std::uint32_t>(SampleTarget::maxSide())};
    if (options.shadows == Shadows::kHard) light.light.size = 0.0F;
    if (options.moves) light.room = lod::draw::kRoomToMove, light.kept_bytes = kStreamedGpuBytes;
    shadows_ = shadow_finder_.find(stream_, nodes_, request, light);
    LUMIGRID_TRY(checkStream(stream_, path_));
  }
  lod::draw::NodeView view;
  view.camera = *request.tile;
  view.shading = shading_;
  const int samples = options.supersampling;
  LUMIGRID_ASSIGN_OR_RETURN(
      const auto count,
      renderer_->draw(nodes_, view, {target.framebuffer(), view.camera.width * samples, view.camera.height * samples},
                      has_shadows ? &shadows_ : nullptr));
  picture.count.triangles += count.triangles;
  picture.count.points += count.points;
  picture.count.lines += count.lines;
  return {};
}

base::Result<HlodPicture> HlodScene::render(const base::Camera& camera, const HlodOptions& options) {
  LUMIGRID_TRY(checkTolerance(options.tolerance));
  LUMIGRID_TRY(checkLight(options));
  HlodPicture picture;
  // A place that lies in several tiles is shown by the same node in all of them.
  lod::hlod::TraverseRequest request;
  request.camera = camera;
  request.tolerance = options.tolerance;
  LUMIGRID_ASSIGN_OR_RETURN(picture.rgba, tiles_->draw(
                                              camera, options,
                                              [&](const base::Camera& tile, const SampleTarget& target) {
                                                request.tile = tile;
                                                return drawTile(request, target, options, picture);
                                              },
                                              tileBorder(options.tolerance)));
  return picture;
}

}  // namespace server
