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

/// The values of --shadows, --light-direction, --light-position and --light-size, which programs share.
struct ShadowArguments {
  std::string shadows = "none";
  std::vector<double> direction, position;  ///< empty, or three numbers
  std::optional<double> size;               ///< degrees with a direction, scene units with a position
};

/// Declares the options. `Command`: a CLI::App, which these rooms do not know.
template <class Command>
void declareShadowOptions(Command& command, ShadowArguments& a) {
  command
      .add_option("--shadows", a.shadows,
                  "shadows of --method hlod. none; hard: of a light without size; soft: of one that has a size, with "
                  "penumbrae. With shadows surfaces are shaded, in scenes with colours, too")
      ->type_name("TEXT:{none,hard,soft}");
  command
      .add_option("--light-direction", a.direction,
                  "X,Y,Z: direction towards a light that is infinitely far, along the scene's axes (default: that of "
                  "the scene's light)")
      ->delimiter(',')
      ->expected(3)
      ->default_str("");
  command
      .add_option("--light-position", a.position, "X,Y,Z: a light at this place, in coordinates of the scene's source")
      ->delimiter(',')
      ->expected(3)
      ->default_str("");
  command.add_option("--light-size", a.size,
                     "diameter of the light of --shadows soft: degrees with a direction (default: 0.53, the sun's), "
                     "units of the source with a position (no default)");
}

/// Names the contradiction, one line; empty where there is none. `with_shadows`: the picture's method has shadows.
std::string shadowProblem(const ShadowArguments& a, bool with_shadows);
/// Returns the light of the shadows. `scene_light`: unit, towards the scene's own, which shines where none is given.
/// `origin`: the scene's. The arguments must not contradict themselves.
ShadowLight lightOf(const ShadowArguments& a, const glm::vec3& scene_light, const glm::dvec3& origin);

}  // namespace lod::hlod
