#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/views/camera_paths.h"
#include "server/views/enclosed.h"
#include "server/views/indoors.h"
#include "server/views/random_views.h"

namespace server::cli {
namespace {

struct TourArguments {
  std::string scene;
  std::string output;
  int frames = 24;
  bool around = false;  // also where an option of the orbit or of the viewing box is given
  double turns = 1.0;
  double elevation_degrees = 30.0;
  double distance = 1.2;
  std::vector<int> size{1280, 720};
  int random = 0;
  std::string path;  // of pathNames(); empty: none
  double seconds = PathOptions().seconds;
  unsigned seed = 1;
  double margin = 0.5;
};

base::Result<std::vector<base::ViewCamera>> heldOutViews(const TourArguments& a, const base::Scene& scene,
                                                         const lod::patch::PatchFile* patches, const Indoors* indoors) {
  if (patches == nullptr)
    return base::Error{base::ErrorCode::kNotFound, a.scene +
                                                       " has no patches, which --random needs; build them with "
                                                       "`lumigrid build ... --methods patch`, or use --frames"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto enclosure, Enclosure::create(*patches));
  auto views = randomViews(scene, enclosure,
                           {static_cast<std::size_t>(a.random), a.seed, a.margin, a.size[0], a.size[1], indoors});
  if (views.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       a.scene + ": the model leaves no room for a view; raise --margin"};
  return views;
}

base::Result<void> run(const TourArguments& a) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(a.scene));
  const bool is_from_rooms = scene.interior && !a.around;
  std::optional<lod::patch::PatchFile> patches;
  if ((is_from_rooms || a.random > 0) && base::partFile(scene, "patch", ".lgp")) {
    LUMIGRID_ASSIGN_OR_RETURN(patches, lod::patch::PatchFile::open(base::patchPath(a.scene, scene)));
  }
  std::optional<Indoors> rooms;
  if (is_from_rooms && patches) {
    LUMIGRID_ASSIGN_OR_RETURN(rooms, Indoors::ofScene(scene, *patches));
  }
  const Indoors* indoors = rooms ? &*rooms : nullptr;
  if (!a.path.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto path,
                              makePath(a.path, scene, {a.size[0], a.size[1], a.seconds, a.seed}, indoors));
    return base::writeFileAtomically(a.output, base::viewOfText(base::formatCameraPath(path)));
  }
  std::vector<base::ViewCamera> frames;
  if (a.random > 0) {
    LUMIGRID_ASSIGN_OR_RETURN(frames, heldOutViews(a, scene, patches ? &*patches : nullptr, indoors));
  } else if (indoors != nullptr) {
    frames = roomsTour(scene, *indoors, a.frames);
    for (base::ViewCamera& view : frames) view.width = a.size[0], view.height = a.size[1];
  } else {
    frames = base::orbitPath(scene.box_min, scene.box_max, scene.up, a.frames, a.turns,
                             glm::radians(a.elevation_degrees), a.distance, a.size[0], a.size[1]);
  }
  return base::writeFileAtomically(a.output, base::viewOfText(base::formatCameraPath({std::move(frames)})));
}

}  // namespace

RunCommand addTour(CLI::App& command) {
  auto a = std::make_shared<TourArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command.add_option("-o,--output", a->output, "JSON file to write")->required();
  command.add_option("--frames", a->frames, "number of cameras")->check(CLI::Range(1, 100000));
  const std::vector<CLI::Option*> of_orbit = {
      command.add_option("--turns", a->turns, "turns around the model"),
      command.add_option("--elevation", a->elevation_degrees, "degrees above the horizon")
          ->check(CLI::Range(-89.0, 89.0)),
      command.add_option("--distance", a->distance, "from the centre, in diagonals of the bounding box")
          ->check(CLI::Range(0.01, 100.0)),
      command.add_option("--margin", a->margin, "margin of the viewing box, as for `lumigrid build`")
          ->check(CLI::Range(0.0, 100.0))};
  command.add_flag("--around", a->around,
                   "views of an interior from around it; without this, or an option of the orbit or the viewing box, "
                   "they are from its rooms");
  command.add_option("--size", a->size, "width and height in pixels, as 640 360 or 640x360")
      ->expected(2)
      ->delimiter('x')
      ->check(CLI::Range(1, 16384));
  command
      .add_option(
          "--random", a->random,
          "this many views from random places in the viewing box, never inside or behind the model, instead of an "
          "orbit; 0: none")
      ->check(CLI::Range(0, 100000));
  command
      .add_option("--path", a->path,
                  "a path in time, 60 views a second, instead of an orbit of still ones, as lumigrid-compare plays it")
      ->check(CLI::IsMember(pathNames()));
  command.add_option("--seconds", a->seconds, "duration of --path")->check(CLI::Range(0.1, 600.0));
  command.add_option("--seed", a->seed, "seed of random views and of the path teleports");
  return [a, of_orbit] {
    a->around =
        a->around || std::any_of(of_orbit.begin(), of_orbit.end(), [](const auto* one) { return one->count() > 0; });
    return exitStatus(run(*a));
  };
}

}  // namespace server::cli
