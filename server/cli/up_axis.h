#pragma once
// The axes that may point up, by the names that options and scene.json's parameters have for them.
#include <glm/glm.hpp>
#include <string>
#include <vector>

namespace server::cli {

inline const std::vector<std::string>& axisNames() {
  static const std::vector<std::string> kNames{"x", "y", "z", "-x", "-y", "-z"};
  return kNames;
}

/// The unit vector along one of axisNames().
inline glm::dvec3 axisNamed(const std::string& name) {
  glm::dvec3 axis(0.0);
  axis[name.back() - 'x'] = name.front() == '-' ? -1.0 : 1.0;
  return axis;
}

}  // namespace server::cli
