// hlod_bench SCENE [--width W] [--height H] [--frames N] [--samples N] [--only LIGHT]
// Flies around a scene with an hlod.lgh, near and far, by the server's renderer: without shadows, with hard ones and
// with soft ones (Guthe et al. 2004, table 4), in turn and with what they need decoded and on the GPU. An eye moves by
// a degree with each frame, and the light stands still; or the light moves, too, and no shadow map serves two frames.
// LIGHT, the front of "moves hard" for one, leaves all other flights out but the one without shadows.
#include <algorithm>
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
#include "tests/bench/hlod_scenes.h"

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

/// A degree of an orbit with each frame. Meanwhile the eye goes up and down.
base::Camera cameraAt(const base::Sphere& bounds, int frame, double radii, const bench::PictureSize& size) {
  const double turn = std::numbers::pi / 180.0 * frame;
  return bench::orbitCamera(bounds, turn, 0.3 + 0.4 * std::sin(3.0 * turn), radii, size);
}

/// A flight: seconds of each frame in the mean, and in the slowest one.
struct Flight {
  double mean = 0.0, slowest = 0.0;
};

Flight fly(server::HlodScene& renderer, const bench::PictureSize& size, double radii, int frames,
           server::HlodOptions options, double light_step) {
  Flight flight;
  const glm::vec3 towards(options.light.place);
  for (int frame = 0; frame < frames; ++frame) {
    const float turn = static_cast<float>(light_step * frame);
    options.light.place = glm::vec4(std::cos(turn) * towards.x - std::sin(turn) * towards.y,
                                    std::sin(turn) * towards.x + std::cos(turn) * towards.y, towards.z, 0.0F);
    const double begin = seconds();
    must(renderer.render(cameraAt(renderer.bounds(), frame, radii, size), options));
    const double taken = seconds() - begin;
    flight.mean += taken / frames;
    flight.slowest = std::max(flight.slowest, taken);
  }
  return flight;
}

/// Flies kRuns times after once without looking at the clock, and prints medians.
void printFlights(server::HlodScene& renderer, const bench::PictureSize& size, double radii, int frames,
                  server::HlodOptions options, const std::string& only) {
  double without = 0.0;
  for (const bool light_moves : {false, true})
    for (const Kind& kind : kKinds) {
      const char* light = light_moves ? "moves" : "stands";
      const bool is_first = kind.shadows == server::Shadows::kNone;
      if (is_first ? light_moves : !(std::string(light) + " " + kind.name).starts_with(only)) continue;
      options.shadows = kind.shadows;
      options.light.size = static_cast<float>(kind.degrees * std::numbers::pi / 180.0);
      options.moves = !light_moves;
      const double step = light_moves ? std::numbers::pi / 180.0 : 0.0;
      std::vector<double> means, slowest;
      for (int run = -1; run < kRuns; ++run) {
        const Flight flight = fly(renderer, size, radii, frames, options, step);
        if (run < 0) continue;
        means.push_back(flight.mean), slowest.push_back(flight.slowest);
      }
      if (is_first) without = median(means);
      std::printf("%5.1f  %-9s  %-15s %7.1f %7.1f  %.2f\n", radii, light, kind.name, 1e3 * median(means),
                  1e3 * median(slowest), median(means) / without);
    }
}

}  // namespace

int main(int argc, char** argv) {
  bench::Arguments arguments(argc, argv, "SCENE [--width W] [--height H] [--frames N] [--samples N] [--only LIGHT]");
  const auto side = [&](const char* option, unsigned usual) {
    return static_cast<int>(arguments.number(option, usual, 1U, 8192U));
  };
  const bench::PictureSize size{side("--width", 1280), side("--height", 720)};
  const auto frames = static_cast<int>(arguments.number("--frames", 30U, 1U, 10000U));
  server::HlodOptions options;
  options.supersampling = static_cast<int>(arguments.number("--samples", 1U, 1U, 8U));
  const std::string only = arguments.text("--only", "");
  arguments.finish();
  if (arguments.input().empty()) arguments.wrong();

  const auto context = must(base::HeadlessContext::create());
  const base::Scene scene = must(base::readScene(arguments.input()));
  const auto renderer = must(server::HlodScene::create(arguments.input(), scene));
  options.light.place = glm::vec4(glm::normalize(scene.light.direction), 0.0F);
  std::printf("%s, %d x %d, flights of %d frames, medians of %d\n", context->renderer().c_str(), size.width,
              size.height, frames, kRuns);
  std::printf("radii  light      shadows         mean ms slowest  times that without\n");
  for (const double radii : {1.2, 2.5, 10.0}) printFlights(*renderer, size, radii, frames, options, only);
}
