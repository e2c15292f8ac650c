#include <algorithm>
#include <cstdio>
#include <memory>

#include "base/egl/headless.h"
#include "base/json/camera_file.h"
#include "base/png/png.h"
#include "lod/method.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"
#include "server/render/scene_renderer.h"

namespace server::cmd {
namespace {

struct RenderArguments {
  std::string scene;
  std::string camera;
  std::string output;
  std::string method = "full";
  std::vector<int> size;
  double tolerance_px = 1.0;
  int supersampling = 4;
  std::vector<int> background;
};

// Lays a picture with alpha over an opaque colour.
base::Image over(const base::Image& rgba, const std::vector<int>& background) {
  base::Image rgb(rgba.width, rgba.height, 3);
  for (std::size_t i = 0; i < rgb.pixels.size() / 3; ++i) {
    const int alpha = rgba.pixels[4 * i + 3];
    for (std::size_t c = 0; c < 3; ++c)
      rgb.pixels[3 * i + c] =
          static_cast<std::uint8_t>((rgba.pixels[4 * i + c] * alpha + background[c] * (255 - alpha) + 127) / 255);
  }
  return rgb;
}

int run(const RenderArguments& a) {
  auto scene = base::readScene(a.scene);
  if (!scene) return fail(scene.error());
  auto view = base::readCamera(a.camera);
  if (!view) return fail(view.error());
  if (a.size.size() == 2) {
    view->width = a.size[0];
    view->height = a.size[1];
  }
  auto patches = lod::patch::PatchFile::open(base::patchPath(a.scene, *scene));
  if (!patches) return fail(patches.error());
  auto context = base::HeadlessContext::create();
  if (!context) return fail(context.error());
  auto renderer = SceneRenderer::create(*scene, *patches);
  if (!renderer) return fail(renderer.error());

  RenderOptions options;
  options.tolerance_px =
      lod::methodFromName(a.method) == lod::Method::kFull ? 0.0F : static_cast<float>(a.tolerance_px);
  options.supersampling = a.supersampling;
  const base::Sphere bounds{(*renderer)->sceneCenter(), (*renderer)->sceneRadius()};
  auto picture = (*renderer)->render(base::cameraForScene(*view, scene->origin, bounds), options);
  if (!picture) return fail(picture.error());
  auto written = base::writePng(a.background.size() == 3 ? over(picture->rgba, a.background) : picture->rgba, a.output);
  if (!written) return fail(written.error());
  std::printf("%s: %d x %d, %s triangles drawn\n", a.output.c_str(), view->width, view->height,
              formatCount(picture->triangles).c_str());
  return kDone;
}

}  // namespace

Run addRender(CLI::App& command) {
  auto a = std::make_shared<RenderArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_option("--camera", a->camera, "camera as JSON (docs/formats/camera.md)")->required();
  command
      .add_option("-o,--output", a->output,
                  "PNG file to write (transparent where nothing is seen, unless --background)")
      ->required();
  command
      .add_option("--method", a->method, "full: leaf geometry, the ground truth; patches: the hierarchy at --tolerance")
      ->check(CLI::IsMember({"full", "patches"}))
      ->capture_default_str();
  command.add_option("--tolerance", a->tolerance_px, "largest projected error of --method patches, pixels")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  command.add_option("--size", a->size, "width and height in pixels, instead of the camera's")
      ->expected(2)
      ->check(CLI::Range(1, 65536));
  command.add_option("--supersampling", a->supersampling, "n x n samples a pixel")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  command.add_option("--background", a->background, "red green blue, 0 to 255")->expected(3)->check(CLI::Range(0, 255));
  return [a] { return run(*a); };
}

}  // namespace server::cmd
