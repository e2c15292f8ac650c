// lumigrid set: changes how a scene is shown, in scene.json alone, so that nothing is built or drawn again.
#include <cstdio>
#include <memory>
#include <optional>

#include "base/json/scene_file.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_lock.h"
#include "server/cli/up_axis.h"

namespace server::cli {
namespace {

struct SetArguments {
  std::string scene;
  std::optional<std::string> up, units, title;
};

base::Result<void> run(const SetArguments& a) {
  if (const auto there = base::readScene(a.scene); !there) return there.error();  // before a lock makes the directory
  LUMIGRID_ASSIGN_OR_RETURN(const auto lock, SceneLock::acquire(a.scene, [&](const std::string& holder) {
                              std::fprintf(stderr, "lumigrid: waiting for %s, which has the scene\n", holder.c_str());
                            }));
  // Another process may have changed it while this one waited.
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(a.scene));
  if (a.up) {
    scene.up = axisNamed(*a.up);
    scene.parameters["up"] = *a.up;
  }
  if (a.units) {
    scene.units = *a.units;
    scene.parameters["units"] = *a.units;
  }
  if (a.title) scene.title = *a.title;
  return base::writeSceneFile(scene, a.scene + "/scene.json");
}

}  // namespace

RunCommand addSet(CLI::App& command) {
  auto a = std::make_shared<SetArguments>();
  command.add_option("SCENE", a->scene, "scene directory, built or published")->required();
  command.add_option("--up", a->up, "axis that points up in the first view")
      ->check(CLI::IsMember(axisNames()))
      ->default_str("");
  command.add_option("--units", a->units, "unit of length of the mesh, e.g. m; unknown: not known")->default_str("");
  command.add_option("--title", a->title, "name that viewers show; empty: the directory's")->default_str("");
  return [a] {
    if (!a->up && !a->units && !a->title) {
      std::fprintf(stderr, "lumigrid: set: nothing to set; give --up, --units or --title\n");
      return kWrongUsage;
    }
    return exitStatus(run(*a));
  };
}

}  // namespace server::cli
