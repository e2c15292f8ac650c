// hlod_bench SCENE [--width W] [--height H] [--views N] [--samples N]
// Draws views around a scene with an hlod.lgh, near and far, by the server's renderer: without shadows, with hard ones
// and with soft ones (Guthe et al. 2004, table 4), in turn and with what they need decoded and on the GPU.
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "base/egl/headless.h"
#include "base/json/scene_file.h"
#include "server/render/hlod_scene.h"
#include "tests/bench/bench.h"

namespace {

using bench::median;
using bench::must;
using bench::seconds;

constexpr int kRuns = 3;

struct Kind {
  const char* name;
  server::Shadows shadows;
  double degrees;  ///< diameter of the light
};
constexpr std::array kKinds{Kind{"none", server::Shadows::kNone, 0.0}, Kind{"hard", server::Shadows::kHard, 0.0},
                            Kind{"soft, sun", server::Shadows::kSoft, lod::hlod::kSunDegrees},
                            Kind{"soft, 5 degrees", server::Shadows::kSoft, 5.0}};

struct Size {
  int width = 0, height = 0;
};

/// The views go around the model once and meanwhile up and down three times.
base::Camera cameraAt(const base::Sphere& bounds, int view, int views, double radii, const Size& size) {
  const double turn = 2.0 * std::numbers::pi * view / views;
  base::ViewCamera at;
  const double pitch = 0.3 + 0.4 * std::sin(3.0 * turn);
  const glm::dvec3 away(std::cos(turn) * std::cos(pitch), std::sin(turn) * std::cos(pitch), std::sin(pitch));
  at.position = glm::dvec3(bounds.center) + radii * static_cast<double>(bounds.radius) * away;
  at.direction = -away;
  at.up = {0, 0, 1};
  at.width = size.width;
  at.height = size.height;
  return base::cameraForScene(at, glm::dvec3(0.0), bounds);
}

/// Draws twice and returns the seconds of the second time.
double drawSeconds(server::HlodScene& renderer, const base::Camera& camera, const server::HlodOptions& options) {
  must(renderer.render(camera, options));
  const double begin = seconds();
  must(renderer.render(camera, options));
  return seconds() - begin;
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "SCENE [--width W] [--height H] [--views N] [--samples N]");
  const auto side = [&](const char* option, unsigned usual) {
    return static_cast<int>(arguments.number(option, usual, 1U, 8192U));
  };
  const Size size{side("--width", 1280), side("--height", 720)};
  const auto views = static_cast<int>(arguments.number("--views", 4U, 1U, 1000U));
  server::HlodOptions options;
  options.supersampling = static_cast<int>(arguments.number("--samples", 1U, 1U, 8U));
  arguments.finish();
  if (arguments.input().empty()) arguments.wrong();

  const auto context = must(base::HeadlessContext::create());
  const base::Scene scene = must(base::readScene(arguments.input()));
  const auto renderer = must(server::HlodScene::create(arguments.input(), scene));
  std::printf("%s, %d x %d, medians of %d views\n", context->renderer().c_str(), size.width, size.height, views);
  std::printf("radii  shadows            ms  times that without\n");
  for (const double radii : {1.2, 2.5, 10.0}) {
    std::array<std::vector<double>, kKinds.size()> taken;
    for (int view = 0; view < views; ++view)
      for (int run = 0; run < kRuns; ++run)
        for (std::size_t k = 0; k < kKinds.size(); ++k) {
          options.shadows = kKinds[k].shadows;
          options.light.place = glm::vec4(glm::normalize(scene.light.direction), 0.0F);
          options.light.size = static_cast<float>(kKinds[k].degrees * std::numbers::pi / 180.0);
          taken[k].push_back(drawSeconds(*renderer, cameraAt(renderer->bounds(), view, views, radii, size), options));
        }
    for (std::size_t k = 0; k < kKinds.size(); ++k)
      std::printf("%5.1f  %-15s %6.1f  %.2f\n", radii, kKinds[k].name, 1e3 * median(taken[k]),
                  median(taken[k]) / median(taken[0]));
  }
}
