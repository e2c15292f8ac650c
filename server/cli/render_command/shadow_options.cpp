#include "server/cli/render_command/shadow_options.h"

#include <cmath>
#include <numbers>

#include "base/format_text.h"

namespace server::cli {
namespace {

constexpr const char* kNone = "none";
constexpr const char* kHard = "hard";
constexpr const char* kSoft = "soft";
/// Degrees: a light all over the sky on one side has 180.
constexpr double kLargestLight = 120.0;

glm::dvec3 vectorOf(const std::vector<double>& values) {
  return {values[0], values[1], values[2]};
}

}  // namespace

void declareShadowOptions(CLI::App& command, ShadowArguments& a) {
  command
      .add_option("--shadows", a.shadows,
                  "shadows of --method hlod. hard: of a light without size; soft: of one that has a size, with "
                  "penumbrae. With shadows surfaces are shaded, in scenes with colours, too")
      ->check(CLI::IsMember({kNone, kHard, kSoft}));
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

std::string shadowProblem(const ShadowArguments& a, bool with_shadows) {
  const bool has_light = !a.direction.empty() || !a.position.empty() || a.size.has_value();
  const auto isFinite = [](const std::vector<double>& v) {
    return v.empty() || std::isfinite(glm::length(vectorOf(v)));
  };
  if (a.shadows != kNone && !with_shadows) return "--shadows is for --method hlod";
  if (a.shadows == kNone)
    return has_light ? "--light-direction, --light-position and --light-size are for --shadows hard or soft" : "";
  if (!a.direction.empty() && !a.position.empty())
    return "--light-direction and --light-position are two lights; give one";
  if (!isFinite(a.direction) || !isFinite(a.position)) return "the light's direction and position must be finite";
  if (!a.direction.empty() && !(glm::length(vectorOf(a.direction)) > 0.0))
    return "--light-direction 0,0,0 points nowhere";
  if (a.shadows == kHard) return a.size ? "--light-size is for --shadows soft: the light of hard ones has no size" : "";
  if (!a.position.empty() && !a.size) return "--shadows soft of a --light-position needs its --light-size";
  const double largest = a.position.empty() ? kLargestLight : base::kMaxCoordinate;
  if (a.size && !(*a.size > 0.0 && *a.size <= largest))
    return "--light-size must be above 0" +
           (a.position.empty() ? base::formatText(" and at most %.0f degrees", kLargestLight) : std::string());
  return "";
}

void setShadows(const ShadowArguments& a, const base::Scene& scene, HlodOptions& options) {
  options.shadows = a.shadows == kSoft ? Shadows::kSoft : a.shadows == kHard ? Shadows::kHard : Shadows::kNone;
  const glm::dvec3 towards = a.direction.empty() ? glm::dvec3(scene.light.direction) : vectorOf(a.direction);
  const double degrees = a.size.value_or(kSunDegrees);
  options.light.place = glm::vec4(glm::vec3(glm::normalize(towards)), 0.0F);
  options.light.size = static_cast<float>(degrees * std::numbers::pi / 180.0);
  if (a.position.empty()) return;
  options.light.place = glm::vec4(glm::vec3(vectorOf(a.position) - scene.origin), 1.0F);
  options.light.size = static_cast<float>(a.size.value_or(0.0));
}

}  // namespace server::cli
