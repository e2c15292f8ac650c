#include <algorithm>

#include "base/view_defaults.h"
#include "compare/sim/player.h"

namespace compare {
namespace {

using MakePlayer = base::Result<std::unique_ptr<Player>> (*)(const Stage&, const MethodSetting&, const LinkProfile&);

bool hasImages(const server::OpenScene& scene) {
  return scene.data.images != nullptr;
}
bool canBePublished(const server::OpenScene& scene) {
  return hasImages(scene) && !scene.directory.empty();
}
template <const base::StreamedMethod& of>
bool hasStreamed(const server::OpenScene& scene) {
  return !scene.directory.empty() && server::streamedFile(scene, of) != nullptr;
}
bool hasPatches(const server::OpenScene& scene) {
  return scene.data.patches != nullptr;
}

struct Method {
  std::string name, knob;
  double normal;              ///< the knob's default
  std::vector<double> sweep;  ///< the default among them
  MakePlayer make;
  bool (*can_play)(const server::OpenScene& scene);
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;  ///< played where they are asked for
};

/// A new method is one file and one row here.
const std::vector<Method>& methods() {
  constexpr double kTolerance = base::ViewDefaults::kPatchTolerance;
  constexpr double kQuality = base::ViewDefaults::kQuality;
  constexpr const char* kUnder = "pixels, error of the patches under the images";
  using lod::hlod::Shadows;
  constexpr const char* kOnScreen = "pixels, error on the screen";
  constexpr const char* kAlone = "pixels, error of the patches";
  static const std::vector<double> tolerances{4, 2, 1, 0.5, 0.25};
  static const std::vector<Method> all{
      {"lumigraph", kUnder, kTolerance, tolerances, makeSessionPlayer, hasPatches},
      {"static", kUnder, kTolerance, tolerances, makeStaticPlayer, canBePublished},
      {"paper", kUnder, kTolerance, tolerances, makeSessionPlayer, hasImages},
      {"patches", kAlone, base::ViewDefaults::kAloneTolerance, tolerances, makeSessionPlayer, hasPatches},
      {"qsplat",
       "pixels, diameter of the splats",
       1.0,
       {8, 4, 2, 1, 0.5},
       makeSplatsPlayer,
       hasStreamed<base::kSplatMethod>},
      {"pmr",
       "pixels, radius of the umbrellas",
       1.0,
       {5, 3, 2, 1, 0.5},
       makeUmbrellasPlayer,
       hasStreamed<base::kUmbrellaMethod>},
      {"hlod", kOnScreen, 0.5, tolerances, makeHlodPlayer, hasStreamed<base::kHlodMethod>},
      {"hlod-hard", kOnScreen, 0.5, tolerances, makeHlodPlayer, hasStreamed<base::kHlodMethod>, Shadows::kHard},
      {"hlod-soft", kOnScreen, 0.5, tolerances, makeHlodPlayer, hasStreamed<base::kHlodMethod>, Shadows::kSoft},
      {"frames", "quality of the JPEGs", kQuality, {30, 50, 70, 85, 95}, makeFramesPlayer, hasPatches},
#ifdef LUMIGRID_VIDEO
      {"video", "percent of the link's rate", 80.0, {20, 40, 60, 80, 95}, makeVideoPlayer, hasPatches},
#endif
  };
  return all;
}

const Method* find(const std::string& name) {
  const auto& all = methods();
  const auto it = std::find_if(all.begin(), all.end(), [&](const Method& one) { return one.name == name; });
  return it == all.end() ? nullptr : &*it;
}

}  // namespace

std::string hlodWith(lod::hlod::Shadows shadows) {
  return shadows == lod::hlod::Shadows::kNone ? "hlod" : "hlod-" + std::string(lod::hlod::nameOf(shadows));
}

lod::hlod::Shadows shadowsOf(const std::string& method) {
  const Method* found = find(method);
  return found == nullptr ? lod::hlod::Shadows::kNone : found->shadows;
}

const std::vector<std::string>& methodNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Method& one : methods())
      if (one.shadows == lod::hlod::Shadows::kNone) all.push_back(one.name);
    return all;
  }();
  return names;
}

std::vector<std::string> methodsFor(const server::OpenScene& scene) {
  std::vector<std::string> possible;
  for (const Method& one : methods())
    if (one.shadows == lod::hlod::Shadows::kNone && one.can_play(scene)) possible.push_back(one.name);
  return possible;
}

std::vector<double> knobsOf(const std::string& method, bool sweep) {
  const Method* found = find(method);
  if (found == nullptr) return {};
  return sweep ? found->sweep : std::vector{found->normal};
}

std::string knobName(const std::string& method) {
  const Method* found = find(method);
  return found == nullptr ? "" : found->knob;
}

base::Result<std::unique_ptr<Player>> makePlayer(const Stage& stage, const MethodSetting& setting,
                                                 const LinkProfile& link) {
  const Method* found = find(setting.method);
  if (found == nullptr)
    return base::Error{base::ErrorCode::kInvalidInput, "method '" + setting.method + "': there is none"};
  return found->make(stage, setting, link);
}

}  // namespace compare
