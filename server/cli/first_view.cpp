#include "server/cli/first_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <glm/gtc/constants.hpp>
#include <span>

#include "base/camera.h"
#include "base/file.h"
#include "base/number.h"
#include "base/text.h"
#include "lod/patch/hull.h"
#include "server/views/indoors.h"

namespace server::cli {
namespace {

constexpr std::size_t kMaxPermalink = 512;
constexpr std::size_t kMaxNumber = 40;  // characters

bool isNumber(std::string_view text, double least, double most) {
  const double value = base::parseNumber(text).value_or(std::nan(""));
  return text.size() <= kMaxNumber && value >= least && value <= most;
}

/// Takes what stands before the separator off the front; all of it where there is no separator.
std::string_view takeFront(std::string_view& text, char separator) {
  const std::string_view front = text.substr(0, text.find(separator));
  text.remove_prefix(std::min(text.size(), front.size() + 1));
  return front;
}

/// Whether the text is numbers with commas between them, as many as there are limits and each within ± its own.
bool areNumbers(std::string_view text, std::span<const double> limits) {
  if (static_cast<std::size_t>(std::count(text.begin(), text.end(), ',')) + 1 != limits.size()) return false;
  return std::all_of(limits.begin(), limits.end(),
                     [&](double limit) { return isNumber(takeFront(text, ','), -limit, limit); });
}

bool isPosition(std::string_view value) {
  constexpr std::array kLimits{base::kMaxCoordinate, base::kMaxCoordinate, base::kMaxCoordinate};
  return areNumbers(value, kLimits);
}
bool isDirection(std::string_view value) {
  constexpr std::array kLimits{360.0, 90.0};
  return areNumbers(value, kLimits);
}
bool isDistance(std::string_view value) {
  return isNumber(value, 1e-9, base::kMaxCoordinate);
}
bool isFieldOfView(std::string_view value) {
  return isNumber(value, 0.1, 170.0);
}
bool isMethod(std::string_view value) {
  return value == "lumigraph" || value == "patches" || value == "qsplat" || value == "pmr" || value == "hlod";
}
bool areOptions(std::string_view value) {
  return std::all_of(value.begin(), value.end(), [&](char c) {
    return std::string_view("sco").find(c) != std::string_view::npos && std::count(value.begin(), value.end(), c) == 1;
  });
}
bool isSection(std::string_view value) {
  if (std::count(value.begin(), value.end(), ',') != 2) return false;
  const std::string_view axis = takeFront(value, ',');
  const std::string_view offset = takeFront(value, ',');
  return (axis == "x" || axis == "y" || axis == "z") && (value == "a" || value == "b") &&
         isNumber(offset, -base::kMaxCoordinate, base::kMaxCoordinate);
}

bool isLight(std::string_view value) {
  constexpr std::array kLimits{180.0, 90.0};
  return areNumbers(value, kLimits);
}
bool areShadows(std::string_view value) {
  return value == "none" || value == "hard" || value == "soft";
}

struct LinkPart {
  char name;
  bool is_of_place;
  bool (*is_valid)(std::string_view value);
};
constexpr LinkPart kParts[] = {{'p', true, isPosition},     {'a', true, isDirection}, {'r', true, isDistance},
                               {'f', false, isFieldOfView}, {'m', false, isMethod},   {'o', false, areOptions},
                               {'x', false, isSection},     {'l', false, isLight},    {'s', false, areShadows}};

/// Decimals by which places within a scene of this size are told apart to four digits or more of it.
int decimalsFor(double size) {
  return std::clamp(3 - static_cast<int>(std::floor(std::log10(std::max(1e-6, size)))), 0, 9);
}

/// The link that cuts an interior open and leaves the whole of it in view. The offset has four digits or more of the
/// scene's height.
std::string sectionLink(const base::Scene& scene, float height) {
  int axis = 0;
  while (std::abs(scene.up[axis]) < 0.9) ++axis;
  const double offset = scene.origin[axis] + scene.up[axis] * static_cast<double>(height);
  const int decimals = decimalsFor(scene.box_max[axis] - scene.box_min[axis]);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "v=1&x=%c,%.*f,%c", 'x' + axis, decimals, offset,
                scene.up[axis] > 0.0 ? 'b' : 'a');
  return text.data();
}

}  // namespace

bool isPermalink(std::string_view text) {
  if (text.size() > kMaxPermalink || text.ends_with('&') || takeFront(text, '&') != "v=1") return false;
  std::string seen;
  while (!text.empty()) {
    const std::string_view part = takeFront(text, '&');
    const auto known = std::find_if(std::begin(kParts), std::end(kParts), [&](const LinkPart& one) {
      return part.size() >= 2 && part[0] == one.name && part[1] == '=';
    });
    if (known == std::end(kParts) || seen.find(known->name) != std::string::npos) return false;
    if (!known->is_valid(part.substr(2))) return false;
    seen += known->name;
  }
  // All that say where the eye is, or none of them.
  const auto lacks = [&](const LinkPart& one) { return one.is_of_place && seen.find(one.name) == std::string::npos; };
  const auto missing = std::count_if(std::begin(kParts), std::end(kParts), lacks);
  return missing == 0 || missing == 3;
}

bool isOwnView(std::string_view link) {
  return link.empty() || (link.starts_with("v=1&x=") && std::count(link.begin(), link.end(), '&') == 1);
}

lod::patch::InteriorChoice interiorChoiceOf(const base::Scene& scene) {
  const auto recorded = scene.parameters.find(kInteriorParameter);
  if (recorded == scene.parameters.end()) return lod::patch::InteriorChoice::kAuto;
  return recorded->second == "on" ? lod::patch::InteriorChoice::kOn : lod::patch::InteriorChoice::kOff;
}

std::string linkInto(const Indoors& rooms, const base::Scene& scene) {
  constexpr double kDegrees = 180.0 / glm::pi<double>();
  const glm::vec3& eye = rooms.places().front();
  const glm::vec3 ahead = rooms.widestDirection(eye);
  const glm::dvec3 place = scene.origin + glm::dvec3(eye), direction(ahead);
  const int decimals = decimalsFor(static_cast<double>(rooms.width()));
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(), "v=1&p=%.*f,%.*f,%.*f&a=%.2f,%.2f&r=%.6g&f=60", decimals, place.x, decimals,
                place.y, decimals, place.z, kDegrees * std::atan2(direction.y, direction.x),
                kDegrees * std::asin(std::clamp(direction.z, -1.0, 1.0)),
                static_cast<double>(std::max(rooms.distance(eye, ahead), 0.1F * rooms.width())));
  return text.data();
}

void setFirstView(const lod::patch::Orientation& found, const Indoors* rooms, base::Scene& scene) {
  scene.start_direction = glm::normalize(glm::dvec3(found.direction));
  setHull(found.hull, scene);
  if (!isOwnView(scene.start_view)) return;
  scene.start_view = found.section_height ? sectionLink(scene, *found.section_height)
                     : rooms != nullptr   ? linkInto(*rooms, scene)
                                          : "";
}

void setHull(const std::vector<glm::vec3>& hull, base::Scene& scene) {
  static_assert(lod::patch::kMaxHullPoints <= base::kMaxHull);
  scene.hull.clear();
  for (const glm::vec3& point : hull) scene.hull.push_back(scene.origin + glm::dvec3(point));
}

base::Result<std::string> permalinkIn(const std::string& text) {
  std::string link = text;
  if (std::error_code ignored; std::filesystem::is_regular_file(text, ignored)) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(text));
    link = base::trimmed(base::textOf(bytes));
  }
  link.erase(0, link.find('#') == std::string::npos ? 0 : link.find('#') + 1);
  if (isPermalink(link)) return link;
  return base::Error{base::ErrorCode::kInvalidInput,
                     "set: --start-view is neither a permalink, as `V` copies it in a viewer (v=1&p=...), nor a file "
                     "with one, nor auto"};
}

}  // namespace server::cli
