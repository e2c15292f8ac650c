// lumigrid set: changes how a scene is shown, in scene.json alone, so that nothing is built or drawn again.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <sstream>

#include "base/file.h"
#include "base/format_text.h"
#include "base/json/scene_file.h"
#include "base/number.h"
#include "base/text.h"
#include "lod/patch/format.h"
#include "lod/patch/orientation.h"
#include "protocol/message.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/first_view.h"
#include "server/cli/scene_lock.h"
#include "server/cli/streamed/hull.h"
#include "server/cli/up_axis.h"
#include "server/render/scene_light.h"
#include "server/views/indoors.h"

namespace server::cli {
namespace {

using OptionalText = std::optional<std::string>;

struct SetArguments {
  std::string scene;
  OptionalText up, north, units, crs, title, attribution, background, start_view, light;
  lod::hlod::LightArguments light_place;
};

constexpr OptionalText SetArguments::*kChoices[] = {
    &SetArguments::up,         &SetArguments::north,      &SetArguments::units,
    &SetArguments::crs,        &SetArguments::title,      &SetArguments::attribution,
    &SetArguments::background, &SetArguments::start_view, &SetArguments::light};

constexpr const char* kAutomatic = "auto";

base::Error wrongValue(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "set: " + problem};
}

// ---- Values, of which an empty one takes away what was set

base::Result<void> checkText(const char* option, const OptionalText& text, std::size_t max_bytes) {
  if (!text || (base::isPlainText(*text) && text->size() <= max_bytes)) return {};
  return wrongValue(std::string(option) + " must be one line of UTF-8 of at most " + std::to_string(max_bytes) +
                    " bytes");
}

base::Result<std::optional<double>> northFrom(const std::string& text) {
  if (text.empty()) return std::optional<double>();
  const auto degrees = base::parseNumber(text);
  if (degrees && std::abs(*degrees) <= 360.0) return degrees;
  return wrongValue("--north " + text + ": it must be degrees from -360 to 360, or empty");
}

/// Reads "#rrggbb" or "r,g,b".
base::Result<std::optional<base::Rgb>> backgroundFrom(const std::string& text) {
  if (text.empty()) return std::optional<base::Rgb>();
  if (const auto color = base::parseRgb(text)) return color;
  base::Rgb color{};
  std::istringstream numbers(text);
  std::string number;
  std::size_t count = 0;
  for (; std::getline(numbers, number, ','); ++count) {
    const auto value = base::parseDecimal(number);
    if (count == color.size() || value.value_or(256) > 255) break;
    color[count] = static_cast<std::uint8_t>(*value);
  }
  if (count == color.size() && numbers.eof() && text.back() != ',') return std::optional(color);
  return wrongValue("--background " + text + ": it must be #rrggbb, or red,green,blue of 0 to 255, or empty");
}

/// Checks what can be checked without the scene.
base::Result<void> checkValues(const SetArguments& a) {
  LUMIGRID_TRY(checkText("--units", a.units, protocol::kMaxUnits));
  LUMIGRID_TRY(checkText("--title", a.title, protocol::kMaxText));
  LUMIGRID_TRY(checkText("--attribution", a.attribution, base::kMaxAttribution));
  if (a.crs && !a.crs->empty() && !base::isCrsName(*a.crs))
    return wrongValue("--crs " + *a.crs + ": it must be an authority and its code, as EPSG:32718, or empty");
  return {};
}

// ---- Changes

void setTexts(const SetArguments& a, base::Scene& scene) {
  if (a.units) {
    scene.units = a.units->empty() ? "unknown" : *a.units;
    scene.parameters["units"] = scene.units;
  }
  if (a.crs) scene.crs = *a.crs;
  if (a.title) scene.title = *a.title;
  if (a.attribution) scene.attribution = *a.attribution;
}

// Finds the first view with this up vector; without patches viewers choose where it looks.
base::Result<void> findFirstView(const std::string& directory, base::Scene& scene) {
  scene.start_direction.reset();
  if (!base::partFile(scene, "patch", ".lgp")) return setStreamedHull(directory, scene);
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::patch::PatchFile::open(base::patchPath(directory, scene)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto rooms, Indoors::ofScene(scene, file));
  const glm::vec3 up(scene.up);
  LUMIGRID_ASSIGN_OR_RETURN(const lod::patch::Orientation found,
                            lod::patch::findOrientation(file, &up, interiorChoiceOf(scene)));
  setFirstView(found, rooms ? &*rooms : nullptr, scene);
  return {};
}

// Whether the first view is the one into an interior that a build finds.
base::Result<bool> looksIntoRooms(const std::string& directory, const base::Scene& scene) {
  if (!scene.interior || isOwnView(scene.start_view) || !base::partFile(scene, "patch", ".lgp")) return false;
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::patch::PatchFile::open(base::patchPath(directory, scene)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto rooms, Indoors::ofScene(scene, file));
  return rooms && linkInto(*rooms, scene) == scene.start_view;
}

base::Result<void> setView(const SetArguments& a, base::Scene& scene) {
  if (a.up) {
    LUMIGRID_ASSIGN_OR_RETURN(const bool is_found, looksIntoRooms(a.scene, scene));
    if (is_found) scene.start_view.clear();
    scene.up = axisNamed(*a.up);
    scene.parameters["up"] = *a.up;
  }
  if (a.north) {
    LUMIGRID_ASSIGN_OR_RETURN(scene.north, northFrom(*a.north));
  }
  if (a.background) {
    LUMIGRID_ASSIGN_OR_RETURN(scene.background, backgroundFrom(*a.background));
  }
  if (a.start_view) {
    scene.start_view.clear();
    if (!a.start_view->empty() && *a.start_view != kAutomatic) {
      LUMIGRID_ASSIGN_OR_RETURN(scene.start_view, permalinkIn(*a.start_view));
    }
  }
  if (a.up || (a.start_view && *a.start_view == kAutomatic)) return findFirstView(a.scene, scene);
  return {};
}

bool hasImages(const std::string& directory, const base::Scene& scene) {
  std::error_code ignored;
  return base::partFile(scene, "images", "") || base::partFile(scene, "images/index", ".lgi") ||
         std::filesystem::exists(directory + "/images", ignored);
}

base::LightMode modeOf(const SetArguments& a, const base::Scene& scene) {
  const auto usual = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  return a.light ? base::lightModeNamed(*a.light).value_or(usual) : scene.light.mode;
}

/// The light that is asked for: that of the images, where nothing but its mode was said and they have it.
base::Result<base::Light> chooseLight(const SetArguments& a, const base::Scene& scene, const base::Light& drawn) {
  base::Light light = scene.light;
  light.mode = modeOf(a, scene);
  if (const std::string problem = lod::hlod::lightProblem(a.light_place, shadowsOfMode(light.mode), kLightWords);
      !problem.empty())
    return wrongValue(problem);
  if (!a.light_place.any() && light.mode != scene.light.mode && drawn.mode == light.mode) return drawn;
  if (const auto placed = placeLight(a.light_place, scene, light); !placed) return base::within("set", placed.error());
  return light;
}

/// Records the options that a build would have to be given for this light: those of the command, and where it gives
/// none, those that were recorded for the light before, or the light's place.
void recordLight(const SetArguments& a, const base::Light& before, base::Scene& scene) {
  const base::Light& light = scene.light;
  std::map<std::string, std::string>& recorded = scene.parameters;
  if (a.light) recorded["light"] = *a.light;
  const lod::hlod::LightArguments& place = a.light_place;
  const bool has_size = place.size || recorded.contains("light-size") || light.size != lod::hlod::kSunDegrees;
  const bool is_moved = light.direction != before.direction || light.position != before.position ||
                        !place.direction.empty() || !place.position.empty();
  if (is_moved || !light.hasShadows())
    for (const char* name : {"light-direction", "light-position"}) recorded.erase(name);
  recorded.erase("light-size");
  if (light.mode == base::LightMode::kSoftShadows && has_size) recorded["light-size"] = sizeText(light.size);
  if (!light.hasShadows()) return;
  if (!place.direction.empty()) recorded["light-direction"] = vectorText(lod::hlod::vectorOf(place.direction));
  if (light.position)
    recorded["light-position"] = vectorText(*light.position);
  else if (place.direction.empty() && !recorded.contains("light-direction"))
    recorded["light-direction"] = vectorText(glm::dvec3(light.direction));
}

void warnOfNormals(const base::LightMode before, const base::Scene& scene) {
  const auto normals = scene.parameters.find("normals");
  if (before == base::LightMode::kUnlit && scene.light.mode != base::LightMode::kUnlit &&
      base::partFile(scene, "patch", ".lgp") && normals != scene.parameters.end() && normals->second != "vertices")
    std::fprintf(stderr,
                 "lumigrid: a scene built unlit has the normals of triangles, so that edges of patches may show; "
                 "`lumigrid build --normals vertices` stores smooth ones\n");
}

/// Chooses the light, and keeps in the scene in which one its images were drawn as long as that is another.
base::Result<void> setLight(const SetArguments& a, const std::string& directory, base::Scene& scene) {
  const base::Light before = scene.light, drawn = scene.images_light.value_or(before);
  LUMIGRID_ASSIGN_OR_RETURN(scene.light, chooseLight(a, scene, drawn));
  if (scene.light.hasShadows() && !base::partFile(scene, "hlod", ".lgh"))
    return wrongValue("--light " + std::string(base::nameOf(scene.light.mode)) +
                      ": the scene has no hlod.lgh, whose nodes throw the shadows; `lumigrid build MESH -o " +
                      directory + "` with hlod among its --methods adds it");
  recordLight(a, before, scene);
  warnOfNormals(before.mode, scene);

  scene.images_light.reset();
  if (drawn == scene.light || !hasImages(directory, scene)) return {};
  scene.images_light = drawn;
  if (before == scene.light) return {};
  const bool is_published = base::partFile(scene, "images/index", ".lgi").has_value();
  const std::string advice = is_published ? "draw them again where the scene was built, and publish it again"
                                          : "lumigrid build -o " + directory +
                                                " draws them again (--missing lists them), for servers that start then";
  std::fprintf(stderr, "lumigrid: the images stay as they were drawn, %s; %s\n", base::nameOf(drawn.mode),
               advice.c_str());
  return {};
}

base::Result<void> run(const SetArguments& a) {
  LUMIGRID_TRY(checkValues(a));
  if (const auto there = base::readScene(a.scene); !there) return there.error();  // before a lock makes the directory
  LUMIGRID_ASSIGN_OR_RETURN(const auto lock, SceneLock::acquire(a.scene, [&](const std::string& holder) {
                              std::fprintf(stderr, "lumigrid: waiting for %s, which has the scene\n", holder.c_str());
                            }));
  // Another process may have changed it while this one waited.
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(a.scene));
  setTexts(a, scene);
  LUMIGRID_TRY(setView(a, scene));
  if (a.light || a.light_place.any()) LUMIGRID_TRY(setLight(a, a.scene, scene));
  return base::writeSceneFile(scene, a.scene + "/scene.json");
}

}  // namespace

RunCommand addSet(CLI::App& command) {
  auto a = std::make_shared<SetArguments>();
  command.add_option("SCENE", a->scene, "scene directory, built or published")->required();
  const auto add = [&](const char* name, OptionalText SetArguments::*choice, const char* help) {
    return command.add_option(name, (*a).*choice, help)->default_str("");
  };
  add("--up", &SetArguments::up, "axis that points up in the first view")->check(CLI::IsMember(axisNames()));
  add("--north", &SetArguments::north,
      "where north is, degrees clockwise as seen from above: from +y where up is z, from -z where up is y "
      "(docs/formats/scene.md); empty: not known");
  add("--units", &SetArguments::units, "unit of length of the mesh, e.g. m; unknown: not known");
  add("--crs", &SetArguments::crs,
      "what its coordinates are, by authority and code, e.g. EPSG:32718; empty: not known");
  add("--title", &SetArguments::title, "name that viewers show; empty: the directory's");
  add("--attribution", &SetArguments::attribution, "whom viewers name as the scan's authors; empty: nobody");
  add("--background", &SetArguments::background,
      "colour where there is no model, #rrggbb or red,green,blue; empty: the viewer's own");
  add("--start-view", &SetArguments::start_view,
      "first view: a permalink, a file with one, or auto: the whole model from where most of it is seen, an interior "
      "cut "
      "open below its ceilings; empty: the same without a cut");
  add("--light", &SetArguments::light,
      "unlit: colours as scanned; soft: shaded; hard-shadows, soft-shadows: a light that throws shadows, for scenes "
      "built with hlod; auto: by whether there are colours. Images that were drawn in another light are to be drawn "
      "again")
      ->check(CLI::IsMember({kAutomatic, "unlit", "soft", "hard-shadows", "soft-shadows"}));
  lod::hlod::declareLightOptions(command, a->light_place, kLightWords);
  return [a] {
    const bool is_idle =
        std::none_of(std::begin(kChoices), std::end(kChoices), [&](auto choice) { return ((*a).*choice).has_value(); });
    if (is_idle && !a->light_place.any()) {
      std::fprintf(stderr,
                   "lumigrid: set: nothing to set; give --up, --north, --units, --crs, --title, --attribution, "
                   "--background, --start-view, or --light and the options of its place\n");
      return kWrongUsage;
    }
    return exitStatus(run(*a));
  };
}

}  // namespace server::cli
