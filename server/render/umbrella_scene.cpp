#include "server/render/umbrella_scene.h"

#include <utility>

#include "base/file.h"
#include "lod/disk_bytes.h"

namespace server {
namespace {

// Limits for leaves that are kept for the next picture. What one picture needs is drawn whatever its size, up to the
// first of them.
constexpr std::uint64_t kDecodedBytes = std::uint64_t{4} << 30;
constexpr std::uint64_t kGpuBytes = 512 << 20;

// A point's square reaches about a pixel beyond its centre, and some drivers discard points whose centre lies outside
// the target.
constexpr int kTileBorder = 1;

lod::pmr::StreamOptions wholeFile() {
  lod::pmr::StreamOptions options;
  options.memory_bytes = kDecodedBytes;
  options.decode_per_frame = 0;
  return options;
}

}  // namespace

UmbrellaScene::UmbrellaScene(std::string path, const std::shared_ptr<const lod::FileBytes>& file,
                             const base::Light& light)
    : path_(std::move(path)),
      stream_(file, wholeFile()),
      shading_{light.mode == base::LightMode::kUnlit, light.direction} {}

base::Result<std::unique_ptr<UmbrellaScene>> UmbrellaScene::create(const std::string& directory,
                                                                   const base::Scene& scene) {
  const std::string path = base::streamedPath(directory, scene, base::kUmbrellaMethod);
  auto file = base::PositionedFile::open(path);
  if (!file && file.error().code == base::ErrorCode::kNotFound)
    return base::Error{base::ErrorCode::kNotFound,
                       directory + " has no pmr.lgm; build it with `lumigrid build ... --methods pmr`"};
  if (!file) return file.error();
  const auto bytes = std::make_shared<lod::DiskBytes>(std::move(*file));
  std::unique_ptr<UmbrellaScene> made(new UmbrellaScene(path, bytes, scene.light));
  if (made->stream_.header() == nullptr) return made->damage();
  LUMIGRID_ASSIGN_OR_RETURN(made->renderer_, lod::draw::UmbrellaRenderer::create(kGpuBytes));
  LUMIGRID_ASSIGN_OR_RETURN(made->tiles_, TiledPicture::create(kTileBorder));
  return made;
}

/// The stream says what is wrong with the file, without its name.
base::Error UmbrellaScene::damage() const {
  const std::string& problem = stream_.problem();
  return {base::ErrorCode::kInvalidInput, path_ + ": " + (problem.empty() ? stream_.warning() : problem)};
}

base::Result<void> UmbrellaScene::drawTile(const lod::pmr::TraverseRequest& request, const SampleTarget& target,
                                           int samples, UmbrellaPicture& picture) {
  stream_.update(request, leaves_);
  if (!stream_.problem().empty() || !stream_.warning().empty()) return damage();
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
  if (!(options.tolerance > 0.0F))
    return base::Error{base::ErrorCode::kInvalidInput,
                       "render: a tolerance of " + std::to_string(options.tolerance) + " pixels; it must be above 0"};
  UmbrellaPicture picture;
  // A leaf that lies in several tiles has the same level in all of them.
  lod::pmr::TraverseRequest request;
  request.camera = camera;
  request.tolerance = options.tolerance;
  LUMIGRID_ASSIGN_OR_RETURN(picture.rgba,
                            tiles_->draw(camera, options, [&](const base::Camera& tile, const SampleTarget& target) {
                              request.tile = tile;
                              return drawTile(request, target, options.supersampling, picture);
                            }));
  return picture;
}

}  // namespace server
