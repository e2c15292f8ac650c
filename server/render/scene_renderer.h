#pragma once
// Draws pictures of a patch hierarchy on the server: sampling faces, exact frames, ground truth.
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "base/view_defaults.h"
#include "lod/draw/view_modes.h"
#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "server/render/patch_cache.h"
#include "server/render/patch_shadows.h"
#include "server/render/readback.h"
#include "server/render/sample_target.h"
#include "server/render/tiling.h"

namespace server {

struct RenderOptions {
  float tolerance_px = 1.0F;  ///< largest projected error; 0: leaf geometry (ground truth)
  int supersampling = 1;      ///< n × n samples a pixel, 1..8; box-filtered
  /// Limit for the render target in samples of 8 bytes; a larger picture is drawn in tiles. Default: 4096 × 4096.
  std::uint64_t max_target_samples = std::uint64_t{1} << 24;
  lod::draw::ViewModes modes = {};  ///< only for render(); tints show the patches' projected errors
  base::ErrorMeasure measure = base::ErrorMeasure::kVisible;  ///< of the tolerance
  /// Refinement ends, largest error first, before the patches in view have more triangles, whatever the tolerance.
  std::uint64_t max_triangles = std::numeric_limits<std::uint64_t>::max();
  /// A picture in a light that throws none is drawn in tiles of at most so many samples, so that a core's cache holds
  /// them. With shadows each tile would have maps of its own.
  std::uint64_t tile_samples = std::numeric_limits<std::uint64_t>::max();
  /// More pictures of the scene are to come: shadow maps of all of it are drawn once for those that they serve.
  bool one_of_many = false;
};

/// Returns the options of an exact frame of so many pixels a side: leaves and 4 × 4 samples, and in views of more
/// triangles or pixels as many as can be drawn in a few seconds without a graphics card
/// (docs/decisions/exact-frames.md).
RenderOptions exactFrameOptions(int width, int height);

/// Draws a scene's patches with its own GPU cache. Needs a GL context that is current from create() to the destructor,
/// on one thread. Several renderers on several threads, each with its own context, may share a PatchFile. An error
/// while drawing or reading back drops all pictures that were not delivered yet. In a light that throws shadows
/// surfaces are shaded as lod::draw::NodeRenderer shades them; the casters are those of the scene's hlod.lgh beside the
/// patches.
class SceneRenderer {
 public:
  /// Leaves are drawn with the textures of texture.lgt beside the patches, where the scene lists it.
  /// `gpu_budget_bytes`: limit for uploaded patches, of which the least recently used are evicted; a cut that needs
  /// more is drawn in batches. `patches` must outlive the renderer.
  static base::Result<std::unique_ptr<SceneRenderer>> create(const base::Scene& scene,
                                                             const lod::patch::PatchFile& patches,
                                                             std::uint64_t gpu_budget_bytes = std::uint64_t{2} << 30);

  /// Draws a picture of any camera, perspective or parallel; each side 1..32768 pixels, in tiles where the GL's limit
  /// is lower. The background is transparent black; back faces are drawn. Delivers pictures of renderMany first.
  base::Result<RenderedPicture> render(const base::Camera& camera, const RenderOptions& options);
  /// The two steps of render(). Parts of a picture (tileCamera) that are drawn one by one share the cut of the whole,
  /// so that no seam shows between them.
  base::Result<lod::patch::Cut> selectPatches(const base::Camera& camera, const RenderOptions& options) const;
  base::Result<RenderedPicture> renderPatches(const base::Camera& camera, const lod::patch::Cut& chosen,
                                              const RenderOptions& options);

  /// Draws several cameras of the same `eye` with one cut (the six faces of a sampling point): it is selected without
  /// frustum for the finest of them, then culled for each. Pictures are read back asynchronously: `deliver(i, picture)`
  /// is called for each camera in order while later ones are drawn, first for those of the previous call. A picture
  /// without triangles has no pixels: most faces of a bake look away from the model. finish() delivers the rest.
  base::Result<void> renderMany(const std::vector<base::Camera>& cameras, const RenderOptions& options,
                                const std::function<void(std::size_t camera, RenderedPicture)>& deliver);
  base::Result<void> finish();

  /// Shades by another light from the next picture on. An error leaves the light as it is: kNotFound for shadows of a
  /// scene without hlod.lgh, and those of reading that.
  base::Result<void> setLight(const base::Light& light);

  float sceneRadius() const { return box_.empty() ? 0.0F : 0.5F * box_.diagonal(); }
  glm::vec3 sceneCenter() const { return box_.empty() ? glm::vec3(0.0F) : box_.center(); }

 private:
  /// By SurfaceKind; those with pages only where the scene has textures.
  using Programs = std::array<base::gl::Program, 3>;
  /// Called before a patch is drawn with a program, which is in use.
  using PatchUniforms = std::function<void(const base::gl::Program& program, std::uint32_t patch)>;

  SceneRenderer(const base::Scene& scene, const lod::patch::PatchFile& patches,
                std::optional<lod::texture::TextureFile> textures, std::uint64_t gpu_budget_bytes);
  base::Result<Programs> linkPrograms(const base::Light& light, bool with_modes, int layers) const;
  base::Result<const Programs*> shadowedPrograms(int layers, bool with_modes);
  base::Result<void> drawPicture(const base::Camera& camera, std::span<const std::uint32_t> cut,
                                 const RenderOptions& options, std::function<void(RenderedPicture)> deliver);
  base::Result<void> drawTile(const base::Camera& camera, const base::Camera& tile,
                              std::span<const std::uint32_t> visible, const RenderOptions& options);
  base::Result<void> drawShadowed(const base::Camera& camera, const base::Camera& tile,
                                  std::span<const std::uint32_t> visible, const RenderOptions& options);
  /// `on_prepared`: sets what all patches share, once for each program.
  base::Result<void> drawPatches(const base::Camera& camera, std::span<const DrawnPatch> drawn,
                                 const RenderOptions& options, const Programs& programs,
                                 const std::function<void(const base::gl::Program&)>& on_prepared = nullptr,
                                 const PatchUniforms& set_uniforms = nullptr);
  /// Whether pictures with these options show shadows.
  bool showsShadows(const RenderOptions& options) const { return shadows_ && !options.modes.hasLight(); }
  void prepare(const base::gl::Program& program, const base::Camera& camera, const lod::draw::ViewModes& modes) const;
  std::vector<DrawnPatch> withPages(std::span<const std::uint32_t> patches, const base::Camera& camera,
                                    int samples) const;
  base::Result<void> orDrop(base::Result<void> result);
  std::vector<std::uint32_t> visibleFrom(const base::Camera& camera, std::span<const std::uint32_t> cut) const;
  base::Result<base::Camera> fitted(const base::Camera& camera, std::span<const std::uint32_t> visible) const;
  Tile touchedPart(const base::Camera& tile_camera, std::span<const std::uint32_t> visible, const Tile& tile) const;
  void sortFrontToBack(std::vector<std::uint32_t>& cut, const glm::vec3& eye) const;

  const base::Scene scene_;
  const std::string directory_;
  const lod::patch::PatchFile& patches_;
  const lod::patch::Hierarchy& hierarchy_;
  std::optional<lod::texture::TextureFile> textures_;
  base::Aabb box_;
  bool lit_ = false;  ///< whether the surface program shades by normals
  Programs surface_;
  Programs with_modes_;
  std::unique_ptr<PatchShadows> shadows_;  ///< null where the light throws none
  /// By the layers of the shadow map and whether they know view modes; linked when they are first needed.
  std::map<std::pair<int, bool>, Programs> shadowed_;
  std::unordered_map<std::uint32_t, float> errors_px_;  ///< by patch, for a tinted picture
  ResolvePass resolve_;
  SampleTarget target_;
  PatchCache cache_;
  ReadbackQueue readback_;
  int max_side_ = 0;
};

}  // namespace server
