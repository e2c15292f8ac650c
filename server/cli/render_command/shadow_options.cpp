#include "server/cli/render_command/shadow_options.h"

namespace server::cli {
namespace {

constexpr const char* kNone = "none";
constexpr const char* kHard = "hard";
constexpr const char* kSoft = "soft";
constexpr ShadowWords kWords{"--shadows hard or soft", "--shadows soft"};

/// That which the shadows ask for; nothing where they do not.
std::optional<base::LightMode> modeOf(const ShadowArguments& a) {
  if (a.shadows == kHard) return base::LightMode::kHardShadows;
  if (a.shadows == kSoft) return base::LightMode::kSoftShadows;
  return std::nullopt;
}

}  // namespace

void declareShadowOptions(CLI::App& command, ShadowArguments& a) {
  command
      .add_option("--shadows", a.shadows,
                  "shadows of --method full, patches and hlod, for scenes built with hlod. hard: of a light without "
                  "size; soft: of one that has a size, with penumbrae. With shadows surfaces are shaded, in scenes "
                  "with colours, too (default: those of the scene's light, see `lumigrid build --light`)")
      ->check(CLI::IsMember({kNone, kHard, kSoft}))
      ->default_str("");
  declareLightOptions(command, a.light, kWords);
}

std::string shadowProblem(const ShadowArguments& a, bool with_shadows) {
  if (modeOf(a) && !with_shadows) return "--shadows is for --method full, patches and hlod";
  return lightProblem(a.light, modeOf(a).value_or(base::LightMode::kUnlit), kWords);
}

base::Result<base::Light> lightOf(const ShadowArguments& a, const base::Scene& scene) {
  base::Light light = scene.light;
  if (a.shadows.empty()) return light;
  const auto without = scene.has_colors ? base::LightMode::kUnlit : base::LightMode::kSoft;
  if (const auto mode = modeOf(a))
    light.mode = *mode;
  else if (light.hasShadows())
    light.mode = without;
  LUMIGRID_TRY(placeLight(a.light, scene, light));
  return light;
}

}  // namespace server::cli
