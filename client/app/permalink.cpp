#include "client/app/permalink.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <optional>

#include "base/format_text.h"
#include "base/number.h"
#include "protocol/message.h"

namespace client {
namespace {

constexpr int kVersion = 1;
constexpr std::size_t kMaxNumber = 40;  // characters; the longest that is written has 32
constexpr int kAngleDecimals = 6;       // decimals of angles in degrees: 2e-8 radian
constexpr int kLightDecimals = 1;       // of a light's angles
constexpr int kMaxLinkDecimals = 17;
// The angle of a view whose link names none, and the limits of the angles that are accepted. They are choices.
constexpr double kDefaultFovDegrees = 45.0;
constexpr double kMinFovDegrees = 0.1;
constexpr double kMaxFovDegrees = 170.0;
constexpr double kMinDistance = 1e-9;  // world units
constexpr std::string_view kAxes = "xyz";

base::Error badLink(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "this link cannot be read: " + problem};
}

// ---- numbers ----

/// Writes fixed point without zeros at the end, and without a minus before zero.
std::string shortFixed(double value, int decimals) {
  std::string text = base::formatText("%.*f", decimals, value);
  if (text.find('.') != std::string::npos) {
    text.erase(text.find_last_not_of('0') + 1);
    if (text.back() == '.') text.pop_back();
  }
  return text == "-0" ? "0" : text;
}

std::string significant(double value) {
  return base::formatText("%.9g", value);
}

/// Reads a number within ±limit that is the whole text.
std::optional<double> number(std::string_view text, double limit) {
  if (text.size() > kMaxNumber) return std::nullopt;
  const auto value = base::parseNumber(text);
  return value && std::abs(*value) <= limit ? value : std::nullopt;
}

/// Returns the decimals that resolve a hundred-millionth of `distance`.
int linkDecimals(double distance) {
  return std::clamp(static_cast<int>(std::ceil(8.0 - std::log10(distance))), 0, kMaxLinkDecimals);
}

/// Returns fewer decimals near the poles, where a degree of heading is a small turn.
int headingDecimals(double pitch_degrees) {
  const double width = std::max(std::cos(glm::radians(pitch_degrees)), 1e-30);
  return std::clamp(kAngleDecimals + static_cast<int>(std::floor(std::log10(width))) + 1, 0, kAngleDecimals);
}

/// Returns the number as it will be read back, so that the reader chooses the same digits for the rest.
double asRead(const std::string& text) {
  return base::parseNumber(text).value_or(0.0);
}

// ---- the parts of a link ----

/// Splits at `separator`; nullopt when there are not exactly N pieces.
template <std::size_t N>
std::optional<std::array<std::string_view, N>> split(std::string_view text, char separator) {
  std::array<std::string_view, N> pieces;
  for (std::size_t i = 0; i < N; ++i) {
    const std::size_t end = text.find(separator);
    if ((end == std::string_view::npos) != (i + 1 == N)) return std::nullopt;
    pieces[i] = text.substr(0, end);
    if (i + 1 < N) text.remove_prefix(end + 1);
  }
  return pieces;
}

base::Result<void> readPosition(std::string_view value, ViewState& view) {
  const auto pieces = split<3>(value, ',');
  if (!pieces) return badLink("p (position) must be three numbers");
  for (int i = 0; i < 3; ++i) {
    const auto coordinate = number((*pieces)[static_cast<std::size_t>(i)], protocol::kMaxCoordinate);
    if (!coordinate) return badLink("p (position) must be three numbers within 1e12");
    view.position[i] = *coordinate;
  }
  return {};
}

base::Result<void> readDirection(std::string_view value, ViewState& view) {
  const auto pieces = split<2>(value, ',');
  const auto heading = pieces ? number((*pieces)[0], 360.0) : std::nullopt;
  const auto pitch = pieces ? number((*pieces)[1], 90.0) : std::nullopt;
  if (!heading || !pitch) return badLink("a (direction) must be a heading within 360 and a pitch within 90 degrees");
  const double h = glm::radians(*heading);
  const double p = glm::radians(*pitch);
  view.direction = {std::cos(p) * std::cos(h), std::cos(p) * std::sin(h), std::sin(p)};
  return {};
}

base::Result<void> readDistance(std::string_view value, ViewState& view) {
  const auto distance = number(value, protocol::kMaxCoordinate);
  if (!distance || *distance < kMinDistance)
    return badLink("r (distance of the pivot) must be above 0 and at most 1e12");
  view.pivot_distance = *distance;
  return {};
}

base::Result<void> readFov(std::string_view value, ViewState& view) {
  const auto degrees = number(value, kMaxFovDegrees);
  if (!degrees || *degrees < kMinFovDegrees) return badLink("f (field of view) must lie between 0.1 and 170 degrees");
  view.fov_y = glm::radians(*degrees);
  return {};
}

base::Result<void> readMethod(std::string_view value, ViewState& view) {
  const auto method = methodFromName(value);
  if (!method) return badLink("m (method) must be lumigraph, patches, qsplat, pmr or hlod");
  view.method = *method;
  return {};
}

base::Result<void> readOptions(std::string_view value, ViewState& view) {
  for (const char letter : value) {
    bool* option = letter == 's'   ? &view.statistics
                   : letter == 'c' ? &view.colors_by_resolution
                   : letter == 'o' ? &view.orthographic
                                   : nullptr;
    if (option == nullptr || *option) return badLink("o (options) may hold s, c and o, each once");
    *option = true;
  }
  return {};
}

base::Result<void> readSection(std::string_view value, ViewState& view) {
  const auto pieces = split<3>(value, ',');
  const auto offset = pieces ? number((*pieces)[1], protocol::kMaxCoordinate) : std::nullopt;
  const bool axis = offset && (*pieces)[0].size() == 1 && kAxes.find((*pieces)[0]) != std::string_view::npos;
  if (!axis || ((*pieces)[2] != "a" && (*pieces)[2] != "b"))
    return badLink("x (section) must be an axis, an offset within 1e12, and a or b");
  view.section = {true, static_cast<int>(kAxes.find((*pieces)[0])), (*pieces)[2] == "b", *offset};
  return {};
}

base::Result<void> readLight(std::string_view value, ViewState& view) {
  const auto light = parseLight(value);
  if (!light) return badLink("l (light): " + light.error().message);
  view.light = *light;
  return {};
}

base::Result<void> readShadows(std::string_view value, ViewState& view) {
  const auto shadows = lod::hlod::shadowsFromName(value);
  if (!shadows) return badLink("s (shadows) must be none, hard or soft");
  view.shadows = *shadows;
  return {};
}

using Reader = base::Result<void> (*)(std::string_view, ViewState&);
struct LinkPart {
  char name;
  Reader read;
};
constexpr std::array<LinkPart, 9> kParts{{{'p', readPosition},
                                          {'a', readDirection},
                                          {'r', readDistance},
                                          {'f', readFov},
                                          {'m', readMethod},
                                          {'o', readOptions},
                                          {'x', readSection},
                                          {'l', readLight},
                                          {'s', readShadows}}};

}  // namespace

std::string formatPermalink(const ViewState& view) {
  // Write position and direction.
  const std::string distance = significant(view.pivot_distance);
  const int decimals = linkDecimals(std::max(asRead(distance), kMinDistance));
  const glm::dvec3& d = view.direction;
  const std::string pitch = shortFixed(glm::degrees(std::atan2(d.z, std::hypot(d.x, d.y))), kAngleDecimals);
  const std::string heading = shortFixed(glm::degrees(std::atan2(d.y, d.x)), headingDecimals(asRead(pitch)));
  std::string text = "v=" + std::to_string(kVersion) + "&p=" + shortFixed(view.position.x, decimals) + "," +
                     shortFixed(view.position.y, decimals) + "," + shortFixed(view.position.z, decimals) +
                     "&a=" + heading + "," + pitch + "&r=" + distance;

  // Write what differs from the defaults.
  const std::string fov = shortFixed(glm::degrees(view.fov_y), kAngleDecimals);
  if (fov != shortFixed(kDefaultFovDegrees, kAngleDecimals)) text += "&f=" + fov;
  if (view.method != Method::kLumigraph) text += "&m=" + std::string(nameOf(view.method));
  std::string options;
  if (view.statistics) options += 's';
  if (view.colors_by_resolution) options += 'c';
  if (view.orthographic) options += 'o';
  if (!options.empty()) text += "&o=" + options;
  if (view.section.on)
    text += std::string("&x=") + kAxes[static_cast<std::size_t>(view.section.axis)] + "," +
            shortFixed(view.section.offset, decimals) + (view.section.keep_below ? ",b" : ",a");
  if (view.light.on)
    text +=
        "&l=" + shortFixed(view.light.heading, kLightDecimals) + "," + shortFixed(view.light.height, kLightDecimals);
  if (view.method == Method::kHlod && view.shadows != lod::hlod::Shadows::kNone)
    text += "&s=" + std::string(lod::hlod::nameOf(view.shadows));
  return text;
}

std::optional<base::SectionPlane> Section::plane() const {
  if (!on) return std::nullopt;
  const double side = keep_below ? 1.0 : -1.0;
  base::SectionPlane plane{glm::dvec3(0.0), side * offset};
  plane.normal[axis] = side;
  return plane;
}

glm::dvec3 OwnLight::direction() const {
  const double h = glm::radians(heading), up = glm::radians(height);
  return {std::cos(up) * std::cos(h), std::cos(up) * std::sin(h), std::sin(up)};
}

OwnLight OwnLight::towards(const glm::dvec3& direction) {
  return {true, glm::degrees(std::atan2(direction.y, direction.x)),
          glm::degrees(std::atan2(direction.z, std::hypot(direction.x, direction.y)))};
}

base::Result<OwnLight> parseLight(std::string_view text) {
  const auto pieces = split<2>(text, ',');
  const auto heading = pieces ? number((*pieces)[0], 180.0) : std::nullopt;
  const auto height = pieces ? number((*pieces)[1], 90.0) : std::nullopt;
  if (!heading || !height)
    return base::Error{base::ErrorCode::kInvalidInput,
                       "a light is a heading within 180 and a height within 90 degrees: 135,20"};
  return OwnLight{true, *heading, *height};
}

base::Result<ViewState> parsePermalink(std::string_view text) {
  if (!text.empty() && text.front() == '#') text.remove_prefix(1);
  if (text.size() > kMaxPermalink) return badLink("it is longer than " + std::to_string(kMaxPermalink) + " characters");
  if (text.substr(0, 2) != "v=") return badLink("it does not begin with v=1");
  const std::string_view version =
      text.substr(2, text.find('&') == std::string_view::npos ? text.npos : text.find('&') - 2);
  if (version != "1") return badLink("it is of another version; this viewer knows version 1");
  text.remove_prefix(std::min(text.size(), 2 + version.size()));

  // Every part may stand once, in any order.
  ViewState view;
  std::array<bool, kParts.size()> seen{};
  while (!text.empty()) {
    text.remove_prefix(1);  // '&'
    const std::string_view part = text.substr(0, text.find('&'));
    text.remove_prefix(part.size());
    const auto known = std::find_if(kParts.begin(), kParts.end(), [&](const LinkPart& p) {
      return part.size() >= 2 && part[0] == p.name && part[1] == '=';
    });
    if (known == kParts.end()) return badLink("it has a part that is not known");
    bool& known_already = seen[static_cast<std::size_t>(known - kParts.begin())];
    if (known_already) return badLink(std::string(1, known->name) + " stands in it twice");
    known_already = true;
    LUMIGRID_TRY(known->read(part.substr(2), view));
  }
  // The first three say where the eye is. Without them it stays where it is.
  const int said = seen[0] + seen[1] + seen[2];
  if (said == 0) view.pivot_distance = 0.0;
  if (said % 3 != 0) return badLink("p, a or r is missing");
  return view;
}

}  // namespace client
