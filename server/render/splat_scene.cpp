#include "server/render/splat_scene.h"

#include <string>
#include <utility>

#include "base/parallel.h"
#include "lod/qsplat/traverse.h"
#include "server/render/readback.h"
#include "server/render/sample_target.h"
#include "server/render/tiling.h"

namespace server {
namespace {

// Tiles that are read back while the next ones are drawn.
constexpr std::size_t kReadbackDepth = 2;
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

struct SplatScene::Impl {
  explicit Impl(std::unique_ptr<lod::qsplat::FileBlocks> of_file)
      : blocks(std::move(of_file)), readback(kReadbackDepth), max_side(SampleTarget::maxSide()) {
    blocks->trackUse();
  }

  base::Result<lod::qsplat::Traversal> splatsFor(const base::Camera& camera, const SplatOptions& options);
  base::Result<void> drawTile(const base::Camera& camera, const lod::qsplat::Traversal& found,
                              const SplatOptions& options);
  base::Result<void> drawPicture(const base::Camera& camera, const SplatOptions& options, SplatPicture& picture,
                                 const std::shared_ptr<PendingPicture>& pending);
  void countBlocks(SplatPicture& picture) const;

  std::unique_ptr<lod::qsplat::FileBlocks> blocks;
  std::uint32_t frame = 0;
  std::unique_ptr<lod::draw::SplatRenderer> renderer;
  lod::draw::Shading shading;
  ResolvePass resolve;
  SampleTarget target;
  ReadbackQueue readback;
  int max_side = 0;
};

SplatScene::~SplatScene() = default;

base::Result<std::unique_ptr<SplatScene>> SplatScene::create(const base::Scene& scene,
                                                             const lod::qsplat::SplatFile& file) {
  LUMIGRID_ASSIGN_OR_RETURN(auto blocks, lod::qsplat::openBlocks(file.bytes(), file.header()));
  std::unique_ptr<SplatScene> made(new SplatScene());
  made->impl_ = std::make_unique<Impl>(std::move(blocks));
  LUMIGRID_ASSIGN_OR_RETURN(made->impl_->renderer, lod::draw::SplatRenderer::create());
  LUMIGRID_ASSIGN_OR_RETURN(made->impl_->resolve, ResolvePass::create());
  made->impl_->shading = {scene.light.mode == base::LightMode::kUnlit, scene.light.direction};
  return made;
}

const base::Sphere& SplatScene::bounds() const {
  return impl_->blocks->header().root;
}

void SplatScene::Impl::countBlocks(SplatPicture& picture) const {
  for (std::uint64_t b = 1; b < blocks->header().blocks(); ++b) {
    if (blocks->lastUse(b) == 0) continue;
    ++picture.blocks;
    picture.bytes += blocks->storedBytes(b);
  }
}

base::Result<lod::qsplat::Traversal> SplatScene::Impl::splatsFor(const base::Camera& camera,
                                                                 const SplatOptions& options) {
  lod::qsplat::TraverseRequest request;
  request.camera = camera;
  request.cutoff_px = options.cutoff_px;
  request.cull_back_faces = options.cull_back_faces;
  request.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
    base::parallelFor(count, 0, body);
  };
  blocks->beginFrame(++frame);
  lod::qsplat::Traversal found = lod::qsplat::traverse(*blocks, request);
  blocks->trim(kDecodedBytes);
  if (blocks->damagedBlock() != 0)
    return lod::qsplat::damaged("qsplat.lgq: block " + std::to_string(blocks->damagedBlock()) +
                                ": checksum does not match");
  if (found.damaged) return lod::qsplat::damaged("qsplat.lgq: its groups don't make a tree");
  return found;
}

base::Result<void> SplatScene::Impl::drawTile(const base::Camera& camera, const lod::qsplat::Traversal& found,
                                              const SplatOptions& options) {
  target.begin();
  lod::draw::SplatView view;
  view.camera = camera;
  view.shading = shading;
  view.two_sided = !options.cull_back_faces;
  return renderer->draw(
      found.splats, options.kernel, view,
      {target.framebuffer(), camera.width * options.supersampling, camera.height * options.supersampling, false});
}

base::Result<void> SplatScene::Impl::drawPicture(const base::Camera& camera, const SplatOptions& options,
                                                 SplatPicture& picture,
                                                 const std::shared_ptr<PendingPicture>& pending) {
  const TilePlan plan =
      planTiles(camera.width, camera.height, options.supersampling, max_side, options.max_target_samples);
  if (!target.matches(plan.tile_width, plan.tile_height, options.supersampling)) {
    target = {};
    LUMIGRID_ASSIGN_OR_RETURN(target, SampleTarget::create(plan.tile_width, plan.tile_height, options.supersampling));
  }
  pending->tiles_left = plan.tiles.size();
  for (const Tile& tile : plan.tiles) {
    const base::Camera tile_camera = tileCamera(camera, tile.x, tile.y, plan.tile_width, plan.tile_height);
    LUMIGRID_ASSIGN_OR_RETURN(auto found, splatsFor(tile_camera, options));
    picture.splats += found.splats.size();
    picture.nodes += found.nodes;
    LUMIGRID_TRY(drawTile(tile_camera, found, options));
    LUMIGRID_TRY(readback.read(pending, tile, target.resolve(resolve), 0, target.height() - tile.height));
  }
  return readback.finish();
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
  auto drawn = impl_->drawPicture(camera, options, picture, pending);
  if (!drawn) {
    impl_->readback.drop();
    return drawn.error();
  }
  impl_->countBlocks(picture);
  return picture;
}

}  // namespace server
