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
#include "server/bake/enclosed.h"
#include "server/bake/random_views.h"
#include "server/net/open_scene.h"
#include "server/render/scene_renderer.h"
#include "server/trial/own_context.h"
#include "tests/bench/bench.h"

namespace bench {

inline constexpr int kTruthSamples = 4;

/// Draws true pictures, or reads those of an earlier run.
class Truths {
 public:
  Truths(const server::OpenScene& scene, std::string directory, base::HeadlessContext& own,
         base::HeadlessContext& other)
      : scene_(scene), directory_(std::move(directory)), gl_(own, other) {
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
  server::OwnContext gl_;
  std::unique_ptr<server::SceneRenderer> renderer_;
};

/// A scene and the random views of it that a benchmark looks at.
struct ViewedScene {
  std::unique_ptr<server::OpenScene> scene;
  std::vector<base::ViewCamera> views;
};

/// Stops where the scene has no images.
inline ViewedScene openWithImages(const std::string& directory, const server::RandomViews& wanted) {
  ViewedScene viewed{must(server::openScene(directory)), {}};
  if (!viewed.scene->images) stop(directory + " has no images; lumigrid build --methods images makes them");
  viewed.views =
      server::randomViews(viewed.scene->scene, must(server::Enclosure::create(viewed.scene->patches)), wanted);
  return viewed;
}

}  // namespace bench
