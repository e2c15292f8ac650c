#pragma once
// Which shadows pictures of a hlod.lgh have and the light that throws them, as command lines, settings and pages say
// it.
#include <array>
#include <cstdint>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "lod/hlod/shadow_cut.h"

namespace lod::hlod {

enum class Shadows : std::uint8_t {
  kNone,
  kHard,  ///< of a light without size
  kSoft,  ///< of one that has a size
};
inline constexpr std::array<std::string_view, 3> kShadowNames{"none", "hard", "soft"};
std::optional<Shadows> shadowsFromName(std::string_view name);
inline constexpr std::string_view nameOf(Shadows shadows) {
  return kShadowNames[static_cast<std::size_t>(shadows)];
}

/// Diameter of the sun as seen from the Earth, degrees and radians.
inline constexpr double kSunDegrees = 0.53;
inline constexpr auto kSunSize = static_cast<float>(kSunDegrees * std::numbers::pi / 180.0);

/// The values of --light-direction, --light-position and --light-size, which programs share.
struct LightArguments {
  std::vector<double> direction, position;  ///< empty, or three numbers
  std::optional<double> size;               ///< degrees with a direction, scene units with a position
  bool any() const { return !direction.empty() || !position.empty() || size.has_value(); }
};
/// `values`: three.
glm::dvec3 vectorOf(const std::vector<double>& values);
/// And that of --shadows.
struct ShadowArguments : LightArguments {
  std::string shadows = "none";
};

/// How a command line asks for shadows.
struct ShadowWords {
  const char* any = "--shadows hard or soft";
  const char* soft = "--shadows soft";
  const char* methods = "hlod";  ///< that have shadows
};

/// Declares the options that place a light. `Command`: a CLI::App, which these rooms do not know.
template <class Command>
void declareLightOptions(Command& command, LightArguments& a, const ShadowWords& words = {}) {
  command
      .add_option("--light-direction", a.direction,
                  std::string("X,Y,Z: direction towards a light that is infinitely far, along the scene's axes, for ") +
                      words.any + " (default: that of the scene's light)")
      ->delimiter(',')
      ->expected(3)
      ->default_str("");
  command
      .add_option("--light-position", a.position, "X,Y,Z: a light at this place, in coordinates of the scene's source")
      ->delimiter(',')
      ->expected(3)
      ->default_str("");
  command.add_option("--light-size", a.size,
                     std::string("diameter of the light of ") + words.soft +
                         ": degrees with a direction (default: 0.53, the sun's), units of the source with a position "
                         "(no default)");
}

/// Declares these and --shadows.
template <class Command>
void declareShadowOptions(Command& command, ShadowArguments& a, const ShadowWords& words = {}) {
  command
      .add_option("--shadows", a.shadows,
                  std::string("shadows of --method ") + words.methods +
                      ". none; hard: of a light without size; soft: of one that has a size, with penumbrae. With "
                      "shadows surfaces are shaded, in scenes with colours, too")
      ->type_name("TEXT:{none,hard,soft}");
  declareLightOptions(command, a, words);
}

/// Name the contradiction, one line; empty where there is none. `with_shadows`: the picture's method has shadows.
std::string shadowProblem(const ShadowArguments& a, bool with_shadows, const ShadowWords& words = {});
std::string lightProblem(const LightArguments& a, Shadows shadows, const ShadowWords& words = {});
/// Returns the light of the shadows. `scene_light`: unit, towards the scene's own, which shines where none is given.
/// `origin`: the scene's. The arguments must not contradict themselves.
ShadowLight lightOf(const LightArguments& a, const glm::vec3& scene_light, const glm::dvec3& origin);

}  // namespace lod::hlod
