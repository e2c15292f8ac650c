#include <cstdio>
#include <memory>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "base/json/scene_file.h"
#include "server/cmd/commands.h"
#include "server/cmd/console.h"

namespace server::cmd {
namespace {

struct TourArguments {
  std::string scene;
  std::string output;
  int frames = 24;
  double turns = 1.0;
  double elevation_degrees = 30.0;
  double distance = 1.2;
  std::vector<int> size{1280, 720};
};

int run(const TourArguments& a) {
  auto scene = base::readScene(a.scene);
  if (!scene) return fail(scene.error());
  const auto path = base::orbitPath(scene->box_min, scene->box_max, scene->up, a.frames, a.turns,
                                    glm::radians(a.elevation_degrees), a.distance, a.size[0], a.size[1]);
  const std::string text = base::formatCameraPath(path);
  auto written = base::writeFileAtomically(a.output, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  if (!written) return fail(written.error());
  return kDone;
}

}  // namespace

Run addTour(CLI::App& command) {
  auto a = std::make_shared<TourArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_option("-o,--output", a->output, "JSON file to write")->required();
  command.add_option("--frames", a->frames, "number of cameras")->check(CLI::Range(1, 100000))->capture_default_str();
  command.add_option("--turns", a->turns, "turns around the model")->capture_default_str();
  command.add_option("--elevation", a->elevation_degrees, "degrees above the horizon")
      ->check(CLI::Range(-89.0, 89.0))
      ->capture_default_str();
  command.add_option("--distance", a->distance, "from the centre, in diagonals of the bounding box")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command.add_option("--size", a->size, "width and height in pixels")
      ->expected(2)
      ->check(CLI::Range(1, 16384))
      ->capture_default_str();
  return [a] { return run(*a); };
}

}  // namespace server::cmd
