#include "server/cli/light_options.h"

#include <cmath>
#include <string_view>

#include "base/format_text.h"
#include "base/number.h"

namespace server::cli {
namespace {

/// Reads "X,Y,Z"; nothing for any other text.
std::optional<glm::dvec3> vectorFrom(std::string_view text) {
  glm::dvec3 v(0.0);
  for (int i = 0; i < 3; ++i) {
    const std::size_t comma = text.find(',');
    if ((comma == std::string_view::npos) != (i == 2)) return std::nullopt;
    const auto number = base::parseNumber(text.substr(0, comma));
    if (!number) return std::nullopt;
    v[i] = *number;
    text.remove_prefix(comma == std::string_view::npos ? text.size() : comma + 1);
  }
  return v;
}

std::string vectorProblem(const char* option, const std::string& text) {
  if (text.empty()) return "";
  const auto v = vectorFrom(text);
  if (!v) return std::string(option) + " " + text + ": give three numbers, X,Y,Z";
  return glm::length(*v) <= base::kMaxCoordinate ? "" : std::string(option) + " " + text + " is too far away";
}

}  // namespace

void declareLightOptions(CLI::App& command, LightArguments& a, const ShadowWords& words) {
  command
      .add_option("--light-direction", a.direction,
                  "X,Y,Z: direction towards a light that is infinitely far, along the scene's axes, for " +
                      std::string(words.any) + " (default: that of the scene's light)")
      ->default_str("");
  command
      .add_option("--light-position", a.position,
                  "X,Y,Z: in place of a direction, a light at this place, in coordinates of the scene's source")
      ->default_str("");
  command.add_option("--light-size", a.size,
                     "diameter of the light of " + std::string(words.soft) +
                         ": degrees with a direction (default: 0.53, the sun's), units of the source with a position "
                         "(no default)");
}

std::string lightProblem(const LightArguments& a, base::LightMode mode, const ShadowWords& words) {
  base::Light light;
  light.mode = mode;
  if (!light.hasShadows())
    return a.any() ? "--light-direction, --light-position and --light-size are for " + std::string(words.any) : "";
  if (!a.direction.empty() && !a.position.empty())
    return "--light-direction and --light-position are two lights; give one";
  for (const auto& [option, text] :
       {std::pair("--light-direction", &a.direction), std::pair("--light-position", &a.position)})
    if (const std::string problem = vectorProblem(option, *text); !problem.empty()) return problem;
  if (!a.direction.empty() && !(glm::length(*vectorFrom(a.direction)) > 0.0))
    return "--light-direction 0,0,0 points nowhere";
  if (mode == base::LightMode::kHardShadows)
    return a.size ? "--light-size is for " + std::string(words.soft) + ": the light of hard ones has no size" : "";
  if (!a.position.empty() && !a.size) return std::string(words.soft) + " of a --light-position needs its --light-size";
  if (!a.position.empty()) light.position = vectorFrom(a.position);
  if (a.size && !(*a.size > 0.0 && *a.size <= base::largestSize(light)))
    return "--light-size must be above 0" +
           (light.position ? std::string() : base::formatText(" and at most %.0f degrees", base::largestSize(light)));
  return "";
}

base::Result<void> placeLight(const LightArguments& a, const base::Scene& scene, base::Light& light) {
  const bool is_moved = !a.direction.empty() || !a.position.empty();
  if (is_moved || !light.hasShadows()) light.position.reset();
  if (is_moved || light.mode != base::LightMode::kSoftShadows) light.size = 0.0;
  if (!a.direction.empty()) light.direction = glm::vec3(glm::normalize(*vectorFrom(a.direction)));
  if (!a.position.empty()) {
    light.position = vectorFrom(a.position);
    const glm::dvec3 towards = *light.position - 0.5 * (scene.box_min + scene.box_max);
    light.direction = glm::vec3(glm::normalize(glm::length(towards) > 0.0 ? towards : scene.up));
  }
  if (light.mode != base::LightMode::kSoftShadows) return {};
  if (a.size) light.size = *a.size;
  if (light.size == 0.0 && light.position)
    return base::Error{base::ErrorCode::kInvalidInput, "soft shadows of a light at a place need its --light-size"};
  if (light.size == 0.0) light.size = base::kSunDegrees;
  return {};
}

}  // namespace server::cli
