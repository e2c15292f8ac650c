#include "lod/hlod/shadow_options.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/format_text.h"

namespace lod::hlod {
namespace {

/// Degrees: a light all over the sky on one side has 180.
constexpr double kLargestLight = 120.0;

}  // namespace

glm::dvec3 vectorOf(const std::vector<double>& values) {
  return {values[0], values[1], values[2]};
}

std::optional<Shadows> shadowsFromName(std::string_view name) {
  const auto* const it = std::find(kShadowNames.begin(), kShadowNames.end(), name);
  if (it == kShadowNames.end()) return std::nullopt;
  return static_cast<Shadows>(it - kShadowNames.begin());
}

std::string shadowProblem(const ShadowArguments& a, bool with_shadows, const ShadowWords& words) {
  const auto shadows = shadowsFromName(a.shadows);
  if (!shadows) return "--shadows must be none, hard or soft";
  if (*shadows != Shadows::kNone && !with_shadows) return std::string("--shadows is for --method ") + words.methods;
  return lightProblem(a, *shadows, words);
}

std::string lightProblem(const LightArguments& a, Shadows shadows, const ShadowWords& words) {
  const auto isFinite = [](const std::vector<double>& v) {
    return v.empty() || std::isfinite(glm::length(vectorOf(v)));
  };
  if (shadows == Shadows::kNone)
    return a.any() ? std::string("--light-direction, --light-position and --light-size are for ") + words.any : "";
  if (!a.direction.empty() && !a.position.empty())
    return "--light-direction and --light-position are two lights; give one";
  if (!isFinite(a.direction) || !isFinite(a.position)) return "the light's direction and position must be finite";
  if (!a.direction.empty() && !(glm::length(vectorOf(a.direction)) > 0.0))
    return "--light-direction 0,0,0 points nowhere";
  if (!a.position.empty() && glm::length(vectorOf(a.position)) > base::kMaxCoordinate)
    return "--light-position is too far away; give its --light-direction";
  if (shadows == Shadows::kHard)
    return a.size ? std::string("--light-size is for ") + words.soft + ": the light of hard ones has no size" : "";
  if (!a.position.empty() && !a.size) return std::string(words.soft) + " of a --light-position needs its --light-size";
  const double largest = a.position.empty() ? kLargestLight : base::kMaxCoordinate;
  if (a.size && !(*a.size > 0.0 && *a.size <= largest))
    return "--light-size must be above 0" +
           (a.position.empty() ? base::formatText(" and at most %.0f degrees", kLargestLight) : std::string());
  return "";
}

ShadowLight lightOf(const LightArguments& a, const glm::vec3& scene_light, const glm::dvec3& origin) {
  if (!a.position.empty())
    return {glm::vec4(glm::vec3(vectorOf(a.position) - origin), 1.0F), static_cast<float>(a.size.value_or(0.0))};
  const glm::dvec3 towards = a.direction.empty() ? glm::dvec3(scene_light) : vectorOf(a.direction);
  const double degrees = a.size.value_or(kSunDegrees);
  return {glm::vec4(glm::vec3(glm::normalize(towards)), 0.0F), static_cast<float>(degrees * std::numbers::pi / 180.0)};
}

}  // namespace lod::hlod
