// lumigrid set: changes how a scene is shown, in scene.json alone, so that nothing is built or drawn again.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "lod/patch/orientation.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_lock.h"
#include "server/cli/up_axis.h"

namespace server::cli {
namespace {

struct SetArguments {
  std::string scene;
  std::optional<std::string> up, units, title, start_view, light;
};

constexpr const char* kAutoView = "auto";
constexpr std::size_t kMaxPermalink = 512;  // docs/formats/permalink.md

// The permalink itself, or the one in the file of that name.
base::Result<std::string> permalinkOf(const std::string& text) {
  std::string link = text;
  if (std::error_code ignored; std::filesystem::is_regular_file(text, ignored)) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(text));
    link.assign(bytes.begin(), bytes.end());
    link.erase(std::min(link.size(), link.find_last_not_of(" \r\n") + 1));
  }
  link.erase(0, link.find('#') == std::string::npos ? 0 : link.find('#') + 1);
  const bool is_plain = std::all_of(link.begin(), link.end(), [](char c) { return c > ' ' && c < 127; });
  if (link.starts_with("v=1&") && is_plain && link.size() <= kMaxPermalink) return link;
  return base::Error{base::ErrorCode::kInvalidInput,
                     "set: --start-view is neither a permalink, as `V` copies it in a viewer (v=1&p=...), nor a file "
                     "with one, nor auto"};
}

// Where the first view looks, with this up vector; splats alone leave it to viewers.
base::Result<std::optional<glm::dvec3>> startDirectionOf(const std::string& directory, const base::Scene& scene) {
  if (!base::partFile(scene, "patch", ".lgp")) return std::optional<glm::dvec3>();
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::patch::PatchFile::open(base::patchPath(directory, scene)));
  const glm::vec3 up(scene.up);
  LUMIGRID_ASSIGN_OR_RETURN(const lod::patch::Orientation found, lod::patch::findOrientation(file, &up));
  return std::optional(glm::normalize(glm::dvec3(found.direction)));
}

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
  if (a.start_view) {
    scene.start_view.clear();
    if (*a.start_view != kAutoView) {
      LUMIGRID_ASSIGN_OR_RETURN(scene.start_view, permalinkOf(*a.start_view));
    }
  }
  if (a.up || (a.start_view && *a.start_view == kAutoView)) {
    LUMIGRID_ASSIGN_OR_RETURN(scene.start_direction, startDirectionOf(a.scene, scene));
  }
  if (a.light) {
    const bool is_drawn = scene.has_colors && *a.light == kAutoView;
    scene.light.mode = *a.light == "unlit" || is_drawn ? base::LightMode::kUnlit : base::LightMode::kSoft;
    scene.parameters["light"] = *a.light;
    if (base::partFile(scene, "images", "") || std::filesystem::exists(a.scene + "/images"))
      std::fprintf(stderr,
                   "lumigrid: the images were drawn in another light; build them again: lumigrid build -o %s "
                   "--methods images --force\n",
                   a.scene.c_str());
  }
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
  command
      .add_option("--start-view", a->start_view,
                  "first view: a permalink, a file with one, or auto: the whole model from where most of it is seen")
      ->default_str("");
  command
      .add_option("--light", a->light, "unlit: colours as scanned; soft: shaded; auto: by whether there are colours")
      ->check(CLI::IsMember({kAutoView, "unlit", "soft"}))
      ->default_str("");
  return [a] {
    if (!a->up && !a->units && !a->title && !a->start_view && !a->light) {
      std::fprintf(stderr, "lumigrid: set: nothing to set; give --up, --units, --title, --start-view or --light\n");
      return kWrongUsage;
    }
    return exitStatus(run(*a));
  };
}

}  // namespace server::cli
