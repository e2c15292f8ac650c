#include "lod/build/soup.h"

#include <algorithm>

namespace lod::build {

void setColors(Soup& soup, const std::vector<glm::vec3>& colors) {
  float highest = 0.0F;
  for (const glm::vec3& c : colors) highest = std::max({highest, c.r, c.g, c.b});
  const double scale = highest > 1.0F ? 1.0 / 255.0 : 1.0;
  soup.colors.clear();
  soup.colors.reserve(colors.size());
  for (const glm::vec3& c : colors) {
    const glm::dvec3 unit = scale * glm::dvec3(c);
    soup.colors.push_back({byteFromUnit(unit.r), byteFromUnit(unit.g), byteFromUnit(unit.b), 255});
  }
}

std::string quoted(std::string_view word) {
  constexpr std::size_t kLongest = 40;
  std::string text = "\"";
  for (const char c : word.substr(0, kLongest)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + (word.size() > kLongest ? "...\"" : "\"");
}

}  // namespace lod::build
