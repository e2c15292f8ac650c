#include "server/render/splat_scene.h"

#include <string>
#include <utility>

#include "base/parallel.h"
#include "server/render/tiling.h"

namespace server {
namespace {

// Tiles that are read back while the next ones are drawn.
constexpr std::size_t kSplatReadbackDepth = 2;
// Limit for decoded blocks of a coded file that are kept for the next picture.
constexpr std::uint64_t kDecodedBytes = 512 << 20;

}  // namespace

base::Result<lod::qsplat::SplatFile> openSplats(const std::string& directory, const base::Scene& scene) {
  auto file = lod::qsplat::SplatFile::open(base::splatPath(directory, scene));
  if (!file && file.error().code == base::ErrorCode::kNotFound)
    return base::Error{base::ErrorCode::kNotFound,
                       directory + " has no qsplat.lgq; build it with `lumigrid build ... --methods qsplat`"};
  return file;
}

SplatScene::SplatScene(std::unique_ptr<lod::qsplat::FileBlocks> blocks, const base::Light& light)
    : blocks_(std::move(blocks)),
      shading_{light.mode == base::LightMode::kUnlit, light.direction},
      readback_(kSplatReadbackDepth),
      max_side_(SampleTarget::maxSide()) {
  blocks_->trackUse();
}

base::Result<std::unique_ptr<SplatScene>> SplatScene::create(const base::Scene& scene,
                                                             const lod::qsplat::SplatFile& file) {
  LUMIGRID_ASSIGN_OR_RETURN(auto blocks, lod::qsplat::openBlocks(file.bytes(), file.header()));
  std::unique_ptr<SplatScene> made(new SplatScene(std::move(blocks), scene.light));
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::SplatRenderer::create());
  LUMIGRID_ASSIGN_OR_RETURN(made->resolve_, ResolvePass::create());
  return made;
}

void SplatScene::countBlocks(SplatPicture& picture) const {
  for (std::uint64_t b = 1; b < blocks_->header().blocks(); ++b) {
    if (blocks_->lastUse(b) == 0) continue;
    ++picture.blocks;
    picture.bytes += blocks_->storedBytes(b);
  }
}

base::Result<lod::qsplat::Traversal> SplatScene::splatsFor(const base::Camera& camera, const SplatOptions& options) {
  lod::qsplat::TraverseRequest request;
  request.camera = camera;
  request.cutoff_px = options.cutoff_px;
  request.cull_back_faces = options.cull_back_faces;
  request.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
    base::parallelFor(count, 0, body);
  };
  blocks_->beginFrame(++frame_);
  lod::qsplat::Traversal found = lod::qsplat::traverse(*blocks_, request);
  blocks_->trim(kDecodedBytes);
  if (blocks_->damagedBlock() != 0)
    return lod::qsplat::damaged("qsplat.lgq: block " + std::to_string(blocks_->damagedBlock()) +
                                " cannot be read, or its checksum does not match");
  if (found.damaged) return lod::qsplat::damaged("qsplat.lgq: its groups don't make a tree");
  return found;
}

base::Result<void> SplatScene::drawTile(const base::Camera& camera, const lod::qsplat::Traversal& found,
                                        const SplatOptions& options) {
  target_.begin();
  lod::draw::SplatView view;
  view.camera = camera;
  view.shading = shading_;
  view.two_sided = !options.cull_back_faces;
  return renderer_->draw(
      found.splats, options.kernel, view,
      {target_.framebuffer(), camera.width * options.supersampling, camera.height * options.supersampling, false});
}

base::Result<void> SplatScene::drawPicture(const base::Camera& camera, const SplatOptions& options,
                                           SplatPicture& picture, const std::shared_ptr<PendingPicture>& pending) {
  const TilePlan plan =
      planTiles(camera.width, camera.height, options.supersampling, max_side_, options.max_target_samples);
  LUMIGRID_TRY(target_.fit(plan.tile_width, plan.tile_height, options.supersampling));
  pending->tiles_left = plan.tiles.size();
  for (const Tile& tile : plan.tiles) {
    const base::Camera tile_camera = tileCamera(camera, tile.x, tile.y, plan.tile_width, plan.tile_height);
    LUMIGRID_ASSIGN_OR_RETURN(auto found, splatsFor(tile_camera, options));
    picture.splats += found.splats.size();
    picture.nodes += found.nodes;
    LUMIGRID_TRY(drawTile(tile_camera, found, options));
    LUMIGRID_TRY(readback_.read(pending, tile, target_.resolve(resolve_), 0, target_.height() - tile.height));
  }
  return readback_.finish();
}

base::Result<SplatPicture> SplatScene::render(const base::Camera& camera, const SplatOptions& options) {
  LUMIGRID_TRY(checkPicture(camera, options.supersampling));
  if (!(options.cutoff_px >= 0.0F))
    return base::Error{base::ErrorCode::kInvalidInput,
                       "render: a cut-off of " + std::to_string(options.cutoff_px) + " pixels; it must be 0 or more"};
  SplatPicture picture;
  auto pending = std::make_shared<PendingPicture>();
  pending->rendered.rgba = base::Image(camera.width, camera.height, 4);
  pending->deliver = [&](RenderedPicture rendered) { picture.rgba = std::move(rendered.rgba); };
  auto drawn = drawPicture(camera, options, picture, pending);
  if (!drawn) {
    readback_.drop();
    return drawn.error();
  }
  countBlocks(picture);
  return picture;
}

}  // namespace server
