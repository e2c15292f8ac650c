#pragma once
// Reads JSON that may hold anything: members that are missing or of another type have a stand-in.
#include <array>
#include <bit>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace mesh::gltf {

using nlohmann::json;

inline constexpr std::uint64_t kMissing = ~std::uint64_t{0};

/// Null where `object` is none or has no such member.
inline const json& member(const json& object, const char* key) {
  static const json nothing;
  if (!object.is_object()) return nothing;
  const auto found = object.find(key);
  return found == object.end() ? nothing : *found;
}

/// Null where `array` is none or has no such item.
inline const json& item(const json& array, std::uint64_t index) {
  static const json nothing;
  return array.is_array() && index < array.size() ? array[index] : nothing;
}

/// How many items an array has; 0 where it is none.
inline std::size_t itemsOf(const json& array) {
  return array.is_array() ? array.size() : 0;
}

/// A non-negative integer, or `otherwise` where it is missing or something else.
inline std::uint64_t integer(const json& value, std::uint64_t otherwise) {
  return value.is_number_unsigned() ? value.get<std::uint64_t>() : otherwise;
}

inline double number(const json& value, double otherwise) {
  return value.is_number() ? value.get<double>() : otherwise;
}

/// An array with as many numbers as the vector or matrix of doubles has.
template <class Vector>
std::optional<Vector> numbers(const json& value) {
  std::array<double, sizeof(Vector) / sizeof(double)> read{};
  if (!value.is_array() || value.size() != read.size()) return std::nullopt;
  for (std::size_t i = 0; i < read.size(); ++i) {
    if (!value[i].is_number()) return std::nullopt;
    read[i] = value[i].template get<double>();
  }
  return std::bit_cast<Vector>(read);
}

/// Empty where it is no string.
inline std::string text(const json& value) {
  return value.is_string() ? value.get<std::string>() : std::string{};
}

/// The extension's object within an element; null where the element has none.
inline const json& extension(const json& element, const char* name) {
  return member(member(element, "extensions"), name);
}

}  // namespace mesh::gltf
