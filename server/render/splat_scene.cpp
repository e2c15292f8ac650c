#include "server/render/splat_scene.h"

#include <string>
#include <utility>

#include "base/parallel.h"

namespace server {
namespace {

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
    : blocks_(std::move(blocks)), shading_{light.mode == base::LightMode::kUnlit, light.direction} {
  blocks_->trackUse();
}

base::Result<std::unique_ptr<SplatScene>> SplatScene::create(const base::Scene& scene,
                                                             const lod::qsplat::SplatFile& file) {
  LUMIGRID_ASSIGN_OR_RETURN(auto blocks, lod::qsplat::openBlocks(file.bytes(), file.header()));
  std::unique_ptr<SplatScene> made(new SplatScene(std::move(blocks), scene.light));
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::SplatRenderer::create());
  LUMIGRID_ASSIGN_OR_RETURN(made->tiles_, TiledPicture::create());
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

base::Result<void> SplatScene::drawTile(const base::Camera& camera, const SplatOptions& options,
                                        const SampleTarget& target, SplatPicture& picture) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto found, splatsFor(camera, options));
  picture.splats += found.splats.size();
  picture.nodes += found.nodes;
  lod::draw::SplatView view;
  view.camera = camera;
  view.shading = shading_;
  view.two_sided = !options.cull_back_faces;
  return renderer_->draw(
      found.splats, options.kernel, view,
      {target.framebuffer(), camera.width * options.supersampling, camera.height * options.supersampling, false});
}

base::Result<SplatPicture> SplatScene::render(const base::Camera& camera, const SplatOptions& options) {
  if (!(options.cutoff_px >= 0.0F))
    return base::Error{base::ErrorCode::kInvalidInput,
                       "render: a cut-off of " + std::to_string(options.cutoff_px) + " pixels; it must be 0 or more"};
  SplatPicture picture;
  LUMIGRID_ASSIGN_OR_RETURN(picture.rgba,
                            tiles_->draw(camera, options, [&](const base::Camera& tile, const SampleTarget& target) {
                              return drawTile(tile, options, target, picture);
                            }));
  countBlocks(picture);
  return picture;
}

}  // namespace server
