#pragma once
// Vectors in JSON. Private to base/json.
#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <optional>

namespace base {

/// Nothing for a value that is not an array of three numbers.
inline std::optional<glm::dvec3> vectorFrom(const nlohmann::json& value) {
  if (!value.is_array() || value.size() != 3) return std::nullopt;
  glm::dvec3 v(0.0);
  for (int i = 0; i < 3; ++i) {
    const nlohmann::json& number = value[static_cast<std::size_t>(i)];
    if (!number.is_number()) return std::nullopt;
    v[i] = number.get<double>();
  }
  return v;
}

inline nlohmann::json toJson(const glm::dvec3& v) {
  return nlohmann::json::array({v.x, v.y, v.z});
}

}  // namespace base
