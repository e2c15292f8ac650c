#pragma once
// The true pictures of random views, which several benchmarks compare with.
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/png/png.h"
#include "server/render/scene_renderer.h"
#include "server/scene/open_scene.h"
#include "server/trial/own_context.h"
#include "server/views/enclosed.h"
#include "server/views/random_views.h"
#include "tests/bench/bench.h"

namespace bench {

inline constexpr int kTruthSamples = 4;

/// Draws true pictures in a context of its own, or reads those of an earlier run. Another context is current for the
/// caller as long as this lives.
class Truths {
 public:
  Truths(const server::OpenScene& scene, std::string directory)
      : scene_(scene),
        directory_(std::move(directory)),
        own_(must(base::HeadlessContext::create())),
        callers_(must(base::HeadlessContext::create())),
        gl_(*own_, *callers_) {
    if (!directory_.empty()) std::filesystem::create_directories(directory_);
    renderer_ = gl_.use([&] { return must(server::SceneRenderer::create(scene_.scene, scene_.patches)); });
  }
  ~Truths() {
    gl_.use([&] { return renderer_.reset(), 0; });
  }
  Truths(const Truths&) = delete;
  Truths& operator=(const Truths&) = delete;

  base::Image of(const base::ViewCamera& view, std::uint32_t seed, std::size_t index) {
    const std::string path = base::formatText("%s/%s_%u_%dx%d_%03zu.png", directory_.c_str(), scene_.name.c_str(), seed,
                                              view.width, view.height, index);
    if (!directory_.empty() && std::filesystem::exists(path)) return must(base::readPng(path));
    const base::Sphere bounds{renderer_->sceneCenter(), renderer_->sceneRadius()};
    const base::Camera camera = base::cameraForScene(view, scene_.scene.origin, bounds);
    auto picture = gl_.use(
        [&] { return must(renderer_->render(camera, {.tolerance_px = 0.0F, .supersampling = kTruthSamples})); });
    if (!directory_.empty()) must(base::writePng(picture.rgba, path));
    return std::move(picture.rgba);
  }

 private:
  const server::OpenScene& scene_;
  const std::string directory_;
  const std::unique_ptr<base::HeadlessContext> own_, callers_;
  server::OwnContext gl_;
  std::unique_ptr<server::SceneRenderer> renderer_;
};

/// The options of benchmarks that look at random views.
struct ViewArguments {
  std::string scene;
  server::RandomViews views;
  std::string truths;  ///< directory of true pictures; "": none are kept
};
inline constexpr const char* kViewUsage = "SCENE [--views 1..1000] [--seed S] [--width W] [--height H] [--truth DIR]";

inline ViewArguments viewArguments(Arguments& given, std::size_t usual_views) {
  if (given.input().empty()) given.wrong();
  ViewArguments taken{given.input(), {}, given.text("--truth", "")};
  taken.views.count = given.number("--views", usual_views, std::size_t{1}, std::size_t{1000});
  taken.views.seed = given.number("--seed", 5U, 0U, 1U << 30U);
  taken.views.width = static_cast<int>(given.number("--width", 640U, 16U, 4096U));
  taken.views.height = static_cast<int>(given.number("--height", 360U, 16U, 4096U));
  return taken;
}

/// A scene and the random views of it that a benchmark looks at.
struct ViewedScene {
  std::unique_ptr<server::OpenScene> scene;
  std::vector<base::ViewCamera> views;
};

/// Stops where the scene has no images.
inline ViewedScene openWithImages(const std::string& directory, const server::RandomViews& wanted) {
  ViewedScene viewed{must(server::openScene(directory)), {}};
  if (!viewed.scene->images) stop(directory + " has no images; lumigrid build --methods images makes them");
  const auto rooms = must(server::Indoors::ofScene(viewed.scene->scene, viewed.scene->patches));
  server::RandomViews views = wanted;
  views.indoors = rooms ? &*rooms : nullptr;
  viewed.views =
      server::randomViews(viewed.scene->scene, must(server::Enclosure::create(viewed.scene->patches)), views);
  return viewed;
}

}  // namespace bench
