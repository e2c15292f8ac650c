#include "compare/painter.h"

#include <filesystem>
#include <utility>

#include "base/file.h"
#include "base/format_text.h"
#include "base/hash/sha256.h"
#include "base/png/png.h"
#include "server/bake/frame_encoder.h"

namespace compare {
namespace {

/// Identifies this build of the program: another one may draw otherwise.
std::string programIdentity() {
  const auto program = base::readFile("/proc/self/exe");
  return program ? base::hexOf(base::sha256(*program)) : program.error().message;
}

/// Everything in a scene that its truth depends on. `with_nodes`: that is drawn of hlod.lgh.
std::string identityOf(const server::OpenScene& scene, bool with_nodes) {
  const base::Light& light = scene.scene.light;
  const glm::dvec3 place = light.position.value_or(glm::dvec3(0.0));
  const auto casters = light.hasShadows() || with_nodes ? base::partFile(scene.scene, "hlod", ".lgh") : std::nullopt;
  std::string parts;
  for (const base::ScenePart& part : scene.scene.parts)
    if (part.file == casters)
      parts += base::formatText(" %d %.17g %.17g %.17g %.17g ", light.position ? 1 : 0, place.x, place.y, place.z,
                                light.size) +
               part.sha256;
  const auto textures = base::partFile(scene.scene, "texture", ".lgt");
  for (const base::ScenePart& part : scene.scene.parts)
    if (part.file == textures) parts += " " + part.sha256;
  const auto patches = scene.patch_file ? scene.patch_file->readAll() : base::Result<base::Bytes>(base::Bytes());
  // Nothing is drawn of a file that cannot be read, so its picture's identity does not matter.
  return (patches ? base::hexOf(base::sha256(*patches)) : patches.error().message) +
         base::formatText(" %d %.9g %.9g %.9g %.17g %.17g %.17g", static_cast<int>(light.mode),
                          static_cast<double>(light.direction.x), static_cast<double>(light.direction.y),
                          static_cast<double>(light.direction.z), scene.scene.origin.x, scene.scene.origin.y,
                          scene.scene.origin.z) +
         parts;
}

}  // namespace

std::string textOf(const base::ViewCamera& c) {
  std::string text =
      base::formatText("%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %d %d", c.position.x,
                       c.position.y, c.position.z, c.direction.x, c.direction.y, c.direction.z, c.up.x, c.up.y, c.up.z,
                       c.fov_y, c.ortho_height, c.width, c.height);
  if (c.section)
    text += base::formatText(" %.17g %.17g %.17g %.17g", c.section->normal.x, c.section->normal.y, c.section->normal.z,
                             c.section->offset);
  return text;
}

// ---- Painter ----

base::Result<std::unique_ptr<Painter>> Painter::create(const server::OpenScene& scene, base::HeadlessContext& gl) {
  if (scene.data.patches == nullptr)
    return base::Error{base::ErrorCode::kUnsupported, "the scene has no patches, of which the truth is drawn"};
  std::unique_ptr<Painter> painter(new Painter(scene, gl));
  LUMIGRID_ASSIGN_OR_RETURN(painter->gl_, base::HeadlessContext::create());
  auto renderer = server::SceneRenderer::create(scene.scene, scene.patches);
  if (renderer) painter->renderer_ = std::move(*renderer);
  gl.makeCurrent();
  if (!renderer) return renderer.error();
  return painter;
}

Painter::~Painter() {
  if (!gl_) return;
  gl_->makeCurrent();
  renderer_.reset();
  nodes_.reset();
  gl_.reset();
  callers_gl_.makeCurrent();
}

base::Result<base::Image> Painter::paint(const base::ViewCamera& camera, const server::RenderOptions& options) {
  gl_->makeCurrent();
  const base::Sphere bounds{renderer_->sceneCenter(), renderer_->sceneRadius()};
  auto picture = renderer_->render(base::cameraForScene(camera, scene_.scene.origin, bounds), options);
  callers_gl_.makeCurrent();
  if (!picture) return picture.error();
  return std::move(picture->rgba);
}

base::Result<base::Image> Painter::paintShadows(const base::ViewCamera& camera, lod::hlod::Shadows shadows,
                                                int supersampling) {
  const auto paint = [&]() -> base::Result<base::Image> {
    if (!nodes_) {
      LUMIGRID_ASSIGN_OR_RETURN(nodes_, server::HlodScene::create(scene_.directory, scene_.scene));
    }
    constexpr float kLeaves = 1e-6F;  // pixels: no node above them is so near
    server::HlodOptions options;
    options.supersampling = supersampling;
    options.tolerance = kLeaves;
    options.shadows = shadows;
    options.light = lod::hlod::lightOf({}, scene_.scene.light.direction, scene_.scene.origin);
    LUMIGRID_ASSIGN_OR_RETURN(
        auto picture, nodes_->render(base::cameraForScene(camera, scene_.scene.origin, nodes_->bounds()), options));
    return std::move(picture.rgba);
  };
  gl_->makeCurrent();
  auto picture = paint();
  callers_gl_.makeCurrent();
  return picture;
}

base::Result<std::shared_ptr<const base::Image>> Painter::exactPicture(const base::ViewCamera& camera) {
  const std::string key = textOf(camera);
  if (const auto* kept = exact_.find(key)) return *kept;
  LUMIGRID_ASSIGN_OR_RETURN(auto rgba, paint(camera, server::exactFrameOptions(camera.width, camera.height)));
  auto picture = std::make_shared<const base::Image>(std::move(rgba));
  exact_.insert(key, picture, picture->pixels.size());
  exact_.evict([](const std::string&) { return false; });
  return std::shared_ptr<const base::Image>(std::move(picture));
}

base::Result<protocol::EncodedFrame> Painter::exactFrame(const server::FrameRequest& request) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto rgba, exactPicture(request.camera));
  return server::encodeFrame(*rgba, request.codec, request.quality);
}

// ---- Truth ----

Truth::Truth(const server::OpenScene& scene, std::string directory, int supersampling, lod::hlod::Shadows shadows)
    : directory_(std::move(directory)),
      identity_(programIdentity() + " " + identityOf(scene, shadows != lod::hlod::Shadows::kNone)),
      samples_(supersampling),
      shadows_(shadows) {
  if (shadows != lod::hlod::Shadows::kNone) identity_ += " " + std::string(lod::hlod::nameOf(shadows));
}

std::string Truth::fileOf(const base::ViewCamera& camera) const {
  const std::string key = identity_ + " " + textOf(camera) + " " + std::to_string(samples_);
  return directory_ + "/" + base::hexOf(base::sha256(base::viewOfText(key))).substr(0, 32) + ".png";
}

base::Result<base::Image> Truth::keptPicture(const base::ViewCamera& camera) const {
  return base::readPng(fileOf(camera));
}

base::Result<base::Image> Truth::picture(const base::ViewCamera& camera, Painter& painter) const {
  if (std::filesystem::exists(fileOf(camera))) return keptPicture(camera);
  LUMIGRID_TRY(base::makeDirectories(directory_));
  auto picture = shadows_ == lod::hlod::Shadows::kNone
                     ? painter.paint(camera, {.tolerance_px = 0.0F, .supersampling = samples_})
                     : painter.paintShadows(camera, shadows_, samples_);
  if (picture) LUMIGRID_TRY(base::writePng(*picture, fileOf(camera)));
  return picture;
}

}  // namespace compare
