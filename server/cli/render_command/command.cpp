#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "base/egl/headless.h"
#include "base/json/camera_file.h"
#include "base/png/png.h"
#include "lod/hlod/shadow_options.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/render/background.h"
#include "server/render/hlod_scene.h"
#include "server/render/scene_light.h"
#include "server/render/scene_renderer.h"
#include "server/render/splat_scene.h"
#include "server/render/streamed_scene.h"
#include "server/render/umbrella_scene.h"

namespace server::cli {
namespace {

// The values of --method.
constexpr const char* kFullMethod = "full";
constexpr const char* kPatchMethod = "patches";
constexpr const char* kSplatMethod = "qsplat";
constexpr const char* kUmbrellaMethod = "pmr";
constexpr const char* kHlodMethod = "hlod";
constexpr lod::hlod::ShadowWords kShadowWords{"--shadows hard or soft", "--shadows soft", "full, patches and hlod"};

struct RenderArguments {
  std::string scene;
  std::string camera;
  std::string output;
  std::string method = kFullMethod;
  std::vector<int> size;
  std::optional<double> tolerance_px;  ///< nothing: the method's usual one
  bool guarantee = false;
  std::string splat = "circle";
  double cutoff_px = 1.0;
  bool back_faces = false;
  int supersampling = 4;
  std::vector<int> background;
  lod::hlod::ShadowArguments shadows{{}, ""};
};

/// A picture, and how much it took to draw: "1,234 triangles".
struct DrawnPicture {
  base::Image rgba;
  std::string amount;
};

std::string shadowProblem(const RenderArguments& a) {
  using lod::hlod::Shadows;
  if (a.shadows.shadows.empty()) return lod::hlod::lightProblem(a.shadows, Shadows::kNone, kShadowWords);
  const bool with_shadows = a.method == kFullMethod || a.method == kPatchMethod || a.method == kHlodMethod;
  return lod::hlod::shadowProblem(a.shadows, with_shadows, kShadowWords);
}

/// The light of the picture: the scene's where nothing is said of shadows.
base::Result<base::Light> lightOf(const lod::hlod::ShadowArguments& a, const base::Scene& scene) {
  base::Light light = scene.light;
  if (a.shadows.empty()) return light;
  const auto shadows = *lod::hlod::shadowsFromName(a.shadows);
  if (shadows != lod::hlod::Shadows::kNone)
    light.mode = shadows == lod::hlod::Shadows::kSoft ? base::LightMode::kSoftShadows : base::LightMode::kHardShadows;
  else if (light.hasShadows())
    light.mode = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  LUMIGRID_TRY(placeLight(a, scene, light));
  return light;
}

/// In pixels; `usual`: where none is given.
float toleranceOf(const RenderArguments& a, float usual) {
  return a.tolerance_px ? static_cast<float>(*a.tolerance_px) : usual;
}

Rgb colorOf(const std::vector<int>& values) {
  Rgb color{};
  for (std::size_t c = 0; c < color.size(); ++c) color[c] = static_cast<std::uint8_t>(values[c]);
  return color;
}

base::Result<DrawnPicture> drawPatches(const RenderArguments& a, const base::Scene& scene,
                                       const base::ViewCamera& view) {
  LUMIGRID_ASSIGN_OR_RETURN(auto patches, openPatchFile(a.scene, scene));
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SceneRenderer::create(scene, patches));
  RenderOptions options;
  options.tolerance_px = a.method == kFullMethod ? 0.0F : toleranceOf(a, 1.0F);
  if (a.guarantee) options.measure = base::ErrorMeasure::kBound;
  options.supersampling = a.supersampling;
  const base::Sphere bounds{renderer->sceneCenter(), renderer->sceneRadius()};
  LUMIGRID_ASSIGN_OR_RETURN(auto picture, renderer->render(base::cameraForScene(view, scene.origin, bounds), options));
  return DrawnPicture{std::move(picture.rgba), formatCount(picture.triangles) + " triangles"};
}

base::Result<DrawnPicture> drawSplats(const RenderArguments& a, const base::Scene& scene,
                                      const base::ViewCamera& view) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, openSplats(a.scene, scene));
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SplatScene::create(scene, file));
  SplatOptions options;
  options.kernel = *lod::draw::splatKernelFromName(a.splat);
  options.cutoff_px = static_cast<float>(a.cutoff_px);
  options.cull_back_faces = !a.back_faces;
  options.supersampling = a.supersampling;
  auto picture = renderer->render(base::cameraForScene(view, scene.origin, renderer->bounds()), options);
  if (!picture) return base::within(a.scene, picture.error());
  return DrawnPicture{std::move(picture->rgba),
                      formatCount(picture->splats) + " splats of " + formatCount(picture->nodes) + " nodes"};
}

base::Result<DrawnPicture> drawUmbrellas(const RenderArguments& a, const base::Scene& scene,
                                         const base::ViewCamera& view) {
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, UmbrellaScene::create(a.scene, scene));
  UmbrellaOptions options;
  options.tolerance = toleranceOf(a, options.tolerance);
  options.supersampling = a.supersampling;
  LUMIGRID_ASSIGN_OR_RETURN(auto picture,
                            renderer->render(base::cameraForScene(view, scene.origin, renderer->bounds()), options));
  return DrawnPicture{std::move(picture.rgba),
                      formatCount(picture.points) + " points and " + formatCount(picture.triangles) + " triangles"};
}

base::Result<DrawnPicture> drawNodes(const RenderArguments& a, const base::Scene& scene, const base::ViewCamera& view) {
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, HlodScene::create(a.scene, scene));
  HlodOptions options;
  options.tolerance = toleranceOf(a, options.tolerance);
  const SceneShadows shadows = shadowsOf(scene.light, scene.origin);
  options.shadows = shadows.shadows;
  options.light = shadows.light;
  options.supersampling = a.supersampling;
  LUMIGRID_ASSIGN_OR_RETURN(auto picture,
                            renderer->render(base::cameraForScene(view, scene.origin, renderer->bounds()), options));
  return DrawnPicture{std::move(picture.rgba), formatCount(picture.count.triangles) + " triangles and " +
                                                   formatCount(picture.count.points) + " points"};
}

base::Result<DrawnPicture> drawPicture(const RenderArguments& a, const base::Scene& scene,
                                       const base::ViewCamera& view) {
  if (a.method == kSplatMethod) return drawSplats(a, scene, view);
  if (a.method == kUmbrellaMethod) return drawUmbrellas(a, scene, view);
  if (a.method == kHlodMethod) return drawNodes(a, scene, view);
  return drawPatches(a, scene, view);
}

/// Options that some methods alone have.
struct MethodOption {
  const char* name;
  std::vector<std::string_view> methods;
};

/// Names the option that the method has not, or cannot have with this value; empty where there is none.
std::string optionProblem(const CLI::App& command, const RenderArguments& a) {
  const std::array<MethodOption, 5> options{{{"--tolerance", {kPatchMethod, kUmbrellaMethod, kHlodMethod}},
                                             {"--guarantee", {kPatchMethod}},
                                             {"--splat", {kSplatMethod}},
                                             {"--cutoff", {kSplatMethod}},
                                             {"--back-faces", {kSplatMethod}}}};
  for (const MethodOption& option : options) {
    if (command.count(option.name) == 0) continue;
    if (std::find(option.methods.begin(), option.methods.end(), a.method) != option.methods.end()) continue;
    std::string methods;
    for (const std::string_view method : option.methods) methods += (methods.empty() ? "" : ", ") + std::string(method);
    return std::string(option.name) + " means nothing with --method " + a.method + "; leave it out (it is for " +
           methods + ")";
  }
  if (a.tolerance_px && !(*a.tolerance_px > 0.0) && a.method != kPatchMethod)
    return "--tolerance must be above 0 with --method " + a.method;
  return shadowProblem(a);
}

base::Result<void> run(const RenderArguments& a) {
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(a.scene));
  LUMIGRID_ASSIGN_OR_RETURN(scene.light, lightOf(a.shadows, scene));
  LUMIGRID_ASSIGN_OR_RETURN(auto view, base::readCamera(a.camera));
  if (a.size.size() == 2) {
    view.width = a.size[0];
    view.height = a.size[1];
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(const auto drawn, drawPicture(a, scene, view));
  LUMIGRID_TRY(base::writePng(a.background.size() == 3 ? compositeOver(drawn.rgba, colorOf(a.background)) : drawn.rgba,
                              a.output));
  std::printf("%s: %d x %d, %s drawn\n", a.output.c_str(), view.width, view.height, drawn.amount.c_str());
  return {};
}

}  // namespace

RunCommand addRender(CLI::App& command) {
  auto a = std::make_shared<RenderArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_option("--camera", a->camera, "camera as JSON (docs/formats/camera.md)")->required();
  command
      .add_option("-o,--output", a->output,
                  "PNG file to write (transparent where nothing is seen, unless --background)")
      ->required();
  command
      .add_option("--method", a->method,
                  "full: leaf geometry, the ground truth; patches: the hierarchy at --tolerance; qsplat: splats at "
                  "--cutoff; pmr: points and umbrellas at --tolerance; hlod: triangles and points at --tolerance")
      ->check(CLI::IsMember({kFullMethod, kPatchMethod, kSplatMethod, kUmbrellaMethod, kHlodMethod}));
  command
      .add_option(
          "--tolerance", a->tolerance_px,
          "error of --method patches, pixels: 19 of 20 points of the surface are within about this; of --method "
          "pmr (above 0): umbrellas have about this many pixels; of --method hlod (above 0): nowhere is shape or "
          "appearance farther off (default: 1, with hlod 0.5)")
      ->check(CLI::Range(0.0, 1000.0));
  command.add_flag("--guarantee", a->guarantee,
                   "keep --tolerance by the proved bound of the error, not by what is seen of it: many times the data");
  command
      .add_option("--splat", a->splat,
                  "kernel of --method qsplat. square: the fastest; circle; fuzzy: softly blended; ellipse: lies in the "
                  "surface, the sharpest, with a hole now and then")
      ->check(CLI::IsMember({"square", "circle", "fuzzy", "ellipse"}));
  command
      .add_option("--cutoff", a->cutoff_px,
                  "splats of --method qsplat are refined down to this diameter, pixels; 0: down to the leaves")
      ->check(CLI::Range(0.0, 1000.0));
  command.add_flag("--back-faces", a->back_faces,
                   "--method qsplat: draw what turns its back, too (default: leave it out); for open surfaces that are "
                   "seen from behind");
  command.add_option("--size", a->size, "width and height in pixels, as 640 360 or 640x360, instead of the camera's")
      ->expected(2)
      ->delimiter('x')
      ->check(CLI::Range(1, 65536))
      ->default_str("");
  command.add_option("--supersampling", a->supersampling, "n x n samples a pixel")->check(CLI::Range(1, 8));
  command.add_option("--background", a->background, "red green blue, 0 to 255")
      ->expected(3)
      ->check(CLI::Range(0, 255))
      ->default_str("");
  lod::hlod::declareShadowOptions(command, a->shadows, kShadowWords);
  command.get_option("--shadows")->default_str("the scene's light, see `lumigrid build --light`");
  return [a, &command] {
    if (const std::string problem = optionProblem(command, *a); !problem.empty()) {
      fail({base::ErrorCode::kInvalidInput, "render: " + problem});
      return kWrongUsage;
    }
    return exitStatus(run(*a));
  };
}

}  // namespace server::cli
