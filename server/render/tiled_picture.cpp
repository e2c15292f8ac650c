#include "server/render/tiled_picture.h"

#include <utility>

namespace server {
namespace {

// Tiles that are read back while the next ones are drawn.
constexpr std::size_t kReadbackDepth = 2;

}  // namespace

TiledPicture::TiledPicture() : readback_(kReadbackDepth), max_side_(SampleTarget::maxSide()) {}

base::Result<std::unique_ptr<TiledPicture>> TiledPicture::create() {
  std::unique_ptr<TiledPicture> made(new TiledPicture);
  LUMIGRID_ASSIGN_OR_RETURN(made->resolve_, ResolvePass::create());
  return made;
}

base::Result<void> TiledPicture::drawTiles(const base::Camera& camera, const SampleOptions& options,
                                           const DrawTile& draw_tile, int border,
                                           const std::shared_ptr<PendingPicture>& pending) {
  const TilePlan plan =
      planTiles(camera.width, camera.height, options.supersampling, max_side_, options.max_target_samples, border);
  const int width = plan.tile_width + 2 * plan.border, height = plan.tile_height + 2 * plan.border;
  LUMIGRID_TRY(target_.fit(width, height, options.supersampling));
  pending->tiles_left = plan.tiles.size();
  for (const Tile& tile : plan.tiles) {
    target_.begin();
    LUMIGRID_TRY(draw_tile(tileCamera(camera, tile.x - plan.border, tile.y - plan.border, width, height), target_));
    LUMIGRID_TRY(
        readback_.read(pending, tile, target_.resolve(resolve_), plan.border, height - plan.border - tile.height));
  }
  return readback_.finish();
}

base::Result<base::Image> TiledPicture::draw(const base::Camera& camera, const SampleOptions& options,
                                             const DrawTile& draw_tile, int border) {
  LUMIGRID_TRY(checkPicture(camera, options.supersampling));
  base::Image picture;
  auto pending = std::make_shared<PendingPicture>();
  pending->rendered.rgba = base::Image(camera.width, camera.height, 4);
  pending->deliver = [&](RenderedPicture rendered) { picture = std::move(rendered.rgba); };
  const auto drawn = drawTiles(camera, options, draw_tile, border, pending);
  if (!drawn) {
    readback_.drop();
    return drawn.error();
  }
  return picture;
}

}  // namespace server
