#include "server/render/scene_renderer.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "lod/draw/near_fit.h"
#include "lod/draw/triangles.h"
#include "server/render/shaders.h"

namespace server {
namespace {

// Behind the units of shadow maps.
constexpr GLint kPageUnit = 2;
// Tiles in flight between drawing and reading.
constexpr std::size_t kReadbackDepth = 4;

// Samples of an exact frame: 4 × 4 a pixel up to 1920 × 1080 pixels, 2 × 2 on a 4K screen.
constexpr std::uint64_t kFrameSamples = 34'000'000;
constexpr int kFrameMinSupersampling = 2;
constexpr int kFrameMaxSupersampling = 4;

std::string definesOf(SurfaceKind kind) {
  if (kind == SurfaceKind::kColors) return "#define SURFACE_COLOR(color) color\n";
  return std::string("#define PAGES\n#define SURFACE_COLOR(color) pageColor(color)\n") +
         (kind == SurfaceKind::kPagesWithAlpha ? "#define ALPHA\n" : "");
}
std::string fragmentOf(SurfaceKind kind, const std::string& source) {
  return definesOf(kind) + (kind == SurfaceKind::kColors ? "" : glsl::kPage) + source;
}

/// Defines SHADED(color) for the fragment shader. `layers`: of the shadow map, 0 for none.
std::string shadedSource(int layers) {
  if (layers == 0)
    return lod::draw::shadingSource() + "#define SHADED(color) shadeSurface(color, seenNormalHere(), v_to_eye)\n";
  return "#define LAYERS " + std::to_string(layers) + "\n" + lod::draw::ShadowMap::shadingSource() +
         "in vec3 v_from_eye;\n#define SHADED(color) shadeInLight(color, v_normal, v_to_eye, v_from_eye)\n";
}

base::Result<base::gl::Program> linkProgram(const base::Light& light, SurfaceKind kind, bool with_modes, int layers) {
  const bool is_unlit = light.mode == base::LightMode::kUnlit;
  if (is_unlit && !with_modes)
    return base::gl::Program::link("unlit", definesOf(kind) + glsl::kUnlitVertex,
                                   fragmentOf(kind, glsl::kUnlitFragment));
  const std::string vertex =
      std::string(layers > 0 ? "#define SHADOWS\n" : "") + definesOf(kind) + glsl::kSurfaceVertex;
  const std::string shading =
      lod::draw::seenNormalSource() + glsl::kSurfaceNormal + shadedSource(layers) +
      (with_modes ? lod::draw::viewModesSource() + glsl::kModesFragment : std::string(glsl::kSurfaceFragment));
  auto program =
      base::gl::Program::link(with_modes ? "surface with modes" : "surface", vertex, fragmentOf(kind, shading));
  if (program && layers == 0) lod::draw::setShading(*program, {is_unlit, light.direction});
  return program;
}

/// The directory of the scene.
std::string directoryOf(const lod::patch::PatchFile& patches) {
  const std::size_t slash = patches.path().rfind('/');
  return slash == std::string::npos ? "." : patches.path().substr(0, slash);
}

base::Result<void> checkRequest(const base::Camera& camera, const RenderOptions& options) {
  LUMIGRID_TRY(checkPicture(camera, options.supersampling));
  if (!(options.tolerance_px >= 0.0F))
    return base::Error{
        base::ErrorCode::kInvalidInput,
        "render: a tolerance of " + std::to_string(options.tolerance_px) + " pixels; it must be 0 or more"};
  return {};
}

/// Selects the patches to draw for a camera at the tolerance (Okamoto 2011, section 4.2).
lod::patch::Cut cutFor(const lod::patch::Hierarchy& hierarchy, const base::Camera& camera, const RenderOptions& options,
                       bool cull) {
  lod::patch::CutRequest request;
  request.camera = camera;
  if (!camera.orthographic()) request.near_plane = base::nearPlaneOf(camera).value_or(request.near_plane);
  request.tolerance_px = options.tolerance_px;
  request.max_triangles = options.max_triangles;
  request.measure = options.measure;
  request.cull = cull;
  return lod::patch::selectCut(hierarchy, request);
}

}  // namespace

RenderOptions exactFrameOptions(int width, int height) {
  int samples = kFrameMaxSupersampling;
  const std::uint64_t pixels = static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height);
  while (samples > kFrameMinSupersampling && pixels * static_cast<std::uint64_t>(samples * samples) > kFrameSamples)
    --samples;
  return {.tolerance_px = 0.0F, .supersampling = samples, .max_triangles = base::ViewDefaults::kFrameTriangles};
}

// ---- Drawing ----

std::vector<std::uint32_t> SceneRenderer::visibleFrom(const base::Camera& camera,
                                                      std::span<const std::uint32_t> cut) const {
  const base::Frustum frustum(camera.clipFromScene());
  std::vector<std::uint32_t> visible;
  for (const std::uint32_t patch : cut)
    if (frustum.mayOverlap(hierarchy_.patches[patch].box)) visible.push_back(patch);
  return visible;
}

// Near patches are drawn first, so that hidden fragments are not shaded. The order depends on the eye alone, so that
// every picture from this eye shows the same one of two coinciding surfaces.
void SceneRenderer::sortFrontToBack(std::vector<std::uint32_t>& cut, const glm::vec3& eye) const {
  std::vector<std::pair<float, std::uint32_t>> keyed;
  keyed.reserve(cut.size());
  for (const std::uint32_t patch : cut) {
    const base::Sphere& bounds = hierarchy_.patches[patch].bounds;
    keyed.emplace_back(glm::length(bounds.center - eye) - bounds.radius, patch);
  }
  std::sort(keyed.begin(), keyed.end());
  for (std::size_t i = 0; i < cut.size(); ++i) cut[i] = keyed[i].second;
}

// Moves the near plane out to the patches. One whose box reaches it is asked for its triangles.
base::Result<base::Camera> SceneRenderer::fitted(const base::Camera& camera,
                                                 std::span<const std::uint32_t> visible) const {
  lod::draw::NearFit fit(camera);
  for (const std::uint32_t patch : visible) {
    if (fit.isKept()) break;
    if (fit.add(hierarchy_.patches[patch].box)) continue;
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, patches_.geometry(patch));
    const auto corner = [&](std::size_t i) {
      return hierarchy_.lattice.position(geometry.positions[geometry.indices[i]]);
    };
    for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3)
      fit.addTriangle(corner(i), corner(i + 1), corner(i + 2));
  }
  return fit.camera();
}

// Returns the part of a tile that patches may touch; the rest stays background and is neither averaged nor read back.
Tile SceneRenderer::touchedPart(const base::Camera& tile_camera, std::span<const std::uint32_t> visible,
                                const Tile& tile) const {
  PixelBounds bounds(tile_camera);
  for (const std::uint32_t patch : visible) bounds.add(hierarchy_.patches[patch].box);
  return bounds.within(tile.width, tile.height);
}

void SceneRenderer::prepare(const base::gl::Program& program, const base::Camera& camera,
                            const lod::draw::ViewModes& modes) const {
  program.use();
  if (modes.alter(camera)) lod::draw::setViewModes(program, modes, camera);
  const glm::mat4 clip_from_scene = camera.clipFromScene();
  glUniformMatrix4fv(program.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  const glm::vec4 eye = camera.homogeneousEye();
  if (lit_ || modes.alter(camera)) glUniform4f(program.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  glUniform1i(program.uniform("u_page"), kPageUnit);
}

/// Says how finely each patch's pages are drawn.
std::vector<DrawnPatch> SceneRenderer::withPages(std::span<const std::uint32_t> patches, const base::Camera& camera,
                                                 int samples) const {
  std::vector<DrawnPatch> drawn;
  drawn.reserve(patches.size());
  for (const std::uint32_t patch : patches)
    drawn.push_back(
        {patch, textures_ ? pageReduction(textures_->pagesOf(patch), hierarchy_.patches[patch].bounds, camera, samples)
                          : kNoPages});
  return drawn;
}

base::Result<void> SceneRenderer::drawPatches(const base::Camera& camera, std::span<const DrawnPatch> drawn,
                                              const RenderOptions& options, const Programs& programs,
                                              const std::function<void(const base::gl::Program&)>& on_prepared,
                                              const PatchUniforms& set_uniforms) {
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glDisable(GL_CULL_FACE);  // scans are seen from behind too
  glDisable(GL_BLEND);
  glDisable(GL_SCISSOR_TEST);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  cache_.setSamples(options.supersampling);
  std::array<bool, 3> prepared{};
  const base::gl::Program* in_use = nullptr;
  const auto use = [&](SurfaceKind kind, std::uint32_t patch) -> const base::gl::Program& {
    const auto k = static_cast<std::size_t>(kind);
    const base::gl::Program& program = programs[k];
    if (!std::exchange(prepared[k], true)) {
      prepare(program, camera, options.modes);
      if (on_prepared) on_prepared(program);
    } else if (in_use != &program) {
      program.use();
    }
    in_use = &program;
    glActiveTexture(GL_TEXTURE0 + kPageUnit);
    if (set_uniforms) set_uniforms(program, patch);
    if (!options.modes.resolution_colors) return program;
    const auto found = errors_px_.find(patch);
    glUniform1f(program.uniform("u_patch_error"), found != errors_px_.end() ? found->second : 0.0F);
    return program;
  };
  auto done = cache_.draw(drawn, use);
  glActiveTexture(GL_TEXTURE0);
  return done;
}

base::Result<void> SceneRenderer::drawTile(const base::Camera& camera, const base::Camera& tile,
                                           std::span<const std::uint32_t> visible, const RenderOptions& options) {
  if (showsShadows(options)) return drawShadowed(camera, tile, visible, options);
  target_.begin();
  return drawPatches(tile, withPages(visible, tile, options.supersampling), options,
                     options.modes.alter(tile) ? with_modes_ : surface_);
}

/// Draws map by map, each before the patches on which it throws shadows.
base::Result<void> SceneRenderer::drawShadowed(const base::Camera& camera, const base::Camera& tile,
                                               std::span<const std::uint32_t> visible, const RenderOptions& options) {
  lod::hlod::TraverseRequest view;
  view.camera = camera;
  view.tile = tile;
  view.tolerance = options.tolerance_px;
  LUMIGRID_TRY(shadows_->plan(view, hierarchy_, visible, options.one_of_many));
  target_.begin();
  const glm::vec4 eye = tile.homogeneousEye();
  for (std::size_t map = 0; map < shadows_->maps(); ++map) {
    const std::vector<PatchShadows::Receiver>& receivers = shadows_->receivers(map);
    if (receivers.empty()) continue;
    LUMIGRID_TRY(shadows_->drawMap(map));
    LUMIGRID_ASSIGN_OR_RETURN(const Programs* programs,
                              shadowedPrograms(shadows_->layers(), options.modes.alter(tile)));
    target_.resume();
    std::vector<std::uint32_t> patches;
    std::unordered_map<std::uint32_t, const PatchShadows::Receiver*> by_patch;
    for (const PatchShadows::Receiver& receiver : receivers) {
      patches.push_back(receiver.patch);
      by_patch.emplace(receiver.patch, &receiver);
    }
    LUMIGRID_TRY(drawPatches(
        tile, withPages(patches, tile, options.supersampling), options, *programs,
        [&](const base::gl::Program& program) { shadows_->use(program, eye.w * glm::vec3(eye)); },
        [&](const base::gl::Program& program, std::uint32_t patch) {
          const PatchShadows::Receiver& receiver = *by_patch.at(patch);
          glUniform1f(program.uniform("u_reach"), receiver.reach);
          glUniform1i(program.uniform("u_one_of_several"), receiver.one_of_several ? 1 : 0);
        }));
    lod::draw::ShadowMap::endUse();
  }
  return {};
}

base::Result<void> SceneRenderer::drawPicture(const base::Camera& from, std::span<const std::uint32_t> cut,
                                              const RenderOptions& options,
                                              std::function<void(RenderedPicture)> deliver) {
  const std::vector<std::uint32_t> visible = visibleFrom(from, cut);
  LUMIGRID_ASSIGN_OR_RETURN(const base::Camera camera, fitted(from, visible));
  auto picture = std::make_shared<PendingPicture>();
  picture->deliver = std::move(deliver);
  for (const std::uint32_t patch : visible) picture->rendered.triangles += hierarchy_.patches[patch].triangles;

  // A picture that shows nothing needs no drawing and no transfer.
  if (visible.empty()) {
    picture->tiles_left = 1;
    return readback_.skip(picture);
  }
  picture->rendered.rgba = base::Image(camera.width, camera.height, 4);

  const std::uint64_t most =
      showsShadows(options) ? options.max_target_samples : std::min(options.max_target_samples, options.tile_samples);
  const TilePlan plan = planTiles(camera.width, camera.height, options.supersampling, max_side_, most);
  LUMIGRID_TRY(target_.fit(plan.tile_width, plan.tile_height, options.supersampling));
  picture->tiles_left = plan.tiles.size();
  for (const Tile& tile : plan.tiles) {
    const base::Camera tile_camera = tileCamera(camera, tile.x, tile.y, plan.tile_width, plan.tile_height);
    const std::vector<std::uint32_t> in_tile = plan.tiles.size() == 1 ? visible : visibleFrom(tile_camera, visible);
    const Tile part = touchedPart(tile_camera, in_tile, tile);
    if (part.width == 0) {
      LUMIGRID_TRY(readback_.skip(picture));
      continue;
    }
    LUMIGRID_TRY(drawTile(camera, tile_camera, in_tile, options));
    LUMIGRID_TRY(readback_.read(picture, {tile.x + part.x, tile.y + part.y, part.width, part.height},
                                target_.resolve(resolve_, part), part.x, target_.height() - part.y - part.height));
  }
  return {};
}

// ---- SceneRenderer ----

SceneRenderer::SceneRenderer(const base::Scene& scene, const lod::patch::PatchFile& patches,
                             std::optional<lod::texture::TextureFile> textures, std::uint64_t gpu_budget_bytes)
    : scene_(scene),
      directory_(directoryOf(patches)),
      patches_(patches),
      hierarchy_(patches.hierarchy()),
      textures_(std::move(textures)),
      cache_(patches, textures_ ? &*textures_ : nullptr, gpu_budget_bytes),
      readback_(kReadbackDepth),
      max_side_(SampleTarget::maxSide()) {
  for (const lod::patch::Patch& patch : hierarchy_.patches) box_.add(patch.box);
}

base::Result<std::unique_ptr<SceneRenderer>> SceneRenderer::create(const base::Scene& scene,
                                                                   const lod::patch::PatchFile& patches,
                                                                   std::uint64_t gpu_budget_bytes) {
  if (glGetString(GL_VERSION) == nullptr)
    return base::Error{base::ErrorCode::kUnsupported,
                       "render: no GL context is current on this thread; make a base::HeadlessContext first"};
  std::optional<lod::texture::TextureFile> textures;
  if (const auto file = base::partFile(scene, "texture", ".lgt")) {
    LUMIGRID_ASSIGN_OR_RETURN(textures, lod::texture::TextureFile::open(directoryOf(patches) + "/" + *file));
  }
  std::unique_ptr<SceneRenderer> renderer(new SceneRenderer(scene, patches, std::move(textures), gpu_budget_bytes));
  LUMIGRID_TRY(renderer->setLight(scene.light));
  LUMIGRID_ASSIGN_OR_RETURN(renderer->resolve_, ResolvePass::create());
  return renderer;
}

base::Result<SceneRenderer::Programs> SceneRenderer::linkPrograms(const base::Light& light, bool with_modes,
                                                                  int layers) const {
  Programs programs;
  for (std::size_t k = 0; k < (textures_ ? programs.size() : 1); ++k) {
    LUMIGRID_ASSIGN_OR_RETURN(programs[k], linkProgram(light, static_cast<SurfaceKind>(k), with_modes, layers));
  }
  return programs;
}

base::Result<const SceneRenderer::Programs*> SceneRenderer::shadowedPrograms(int layers, bool with_modes) {
  const std::pair<int, bool> key(layers, with_modes);
  if (!shadowed_.contains(key)) {
    LUMIGRID_ASSIGN_OR_RETURN(shadowed_[key], linkPrograms({}, with_modes, layers));
  }
  return &shadowed_[key];
}

base::Result<void> SceneRenderer::setLight(const base::Light& light) {
  std::unique_ptr<PatchShadows> shadows;
  if (light.hasShadows()) {
    LUMIGRID_ASSIGN_OR_RETURN(shadows, PatchShadows::create(directory_, scene_, light));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto surface, linkPrograms(light, false, 0));
  LUMIGRID_ASSIGN_OR_RETURN(with_modes_, linkPrograms(light, true, 0));
  surface_ = std::move(surface);
  shadows_ = std::move(shadows);
  lit_ = light.mode != base::LightMode::kUnlit;
  return {};
}

base::Result<void> SceneRenderer::orDrop(base::Result<void> result) {
  if (!result) readback_.drop();
  return result;
}

base::Result<RenderedPicture> SceneRenderer::render(const base::Camera& camera, const RenderOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto chosen, selectPatches(camera, options));
  return renderPatches(camera, chosen, options);
}

base::Result<lod::patch::Cut> SceneRenderer::selectPatches(const base::Camera& camera,
                                                           const RenderOptions& options) const {
  LUMIGRID_TRY(checkRequest(camera, options));
  return cutFor(hierarchy_, camera, options, true);
}

base::Result<RenderedPicture> SceneRenderer::renderPatches(const base::Camera& camera, const lod::patch::Cut& chosen,
                                                           const RenderOptions& options) {
  LUMIGRID_TRY(checkRequest(camera, options));
  LUMIGRID_TRY(finish());
  errors_px_.clear();
  if (options.modes.resolution_colors)
    for (std::size_t i = 0; i < chosen.patches.size(); ++i)
      errors_px_.emplace(chosen.patches[i], chosen.patch_error_px[i]);
  std::vector<std::uint32_t> cut = chosen.patches;
  sortFrontToBack(cut, camera.eye);
  RenderedPicture result;
  LUMIGRID_TRY(
      orDrop(drawPicture(camera, cut, options, [&](RenderedPicture rendered) { result = std::move(rendered); })));
  LUMIGRID_TRY(finish());
  if (result.rgba.empty()) result.rgba = base::Image(camera.width, camera.height, 4);
  return result;
}

base::Result<void> SceneRenderer::renderMany(const std::vector<base::Camera>& cameras, const RenderOptions& options,
                                             const std::function<void(std::size_t camera, RenderedPicture)>& deliver) {
  if (cameras.empty()) return {};
  for (const base::Camera& camera : cameras) {
    LUMIGRID_TRY(checkRequest(camera, options));
    LUMIGRID_CHECK(camera.eye == cameras[0].eye);
  }

  // All cameras share the cut of the one that resolves most.
  const auto finest = std::max_element(
      cameras.begin(), cameras.end(),
      [](const base::Camera& a, const base::Camera& b) { return a.pixelsPerUnitAtOne() < b.pixelsPerUnitAtOne(); });
  std::vector<std::uint32_t> cut = cutFor(hierarchy_, *finest, options, false).patches;
  sortFrontToBack(cut, cameras[0].eye);
  for (std::size_t i = 0; i < cameras.size(); ++i)
    LUMIGRID_TRY(orDrop(drawPicture(cameras[i], cut, options,
                                    [deliver, i](RenderedPicture rendered) { deliver(i, std::move(rendered)); })));
  return {};
}

base::Result<void> SceneRenderer::finish() {
  return orDrop(readback_.finish());
}

}  // namespace server
