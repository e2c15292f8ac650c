#pragma once
// A glTF accessor (section 3.6.2): numbers in memory with a stride.
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>
#include <memory>

#include "base/bytes.h"
#include "mesh/gltf/json_values.h"

namespace mesh::gltf {

enum ComponentType : std::uint64_t {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,
  kFloat = 5126
};

/// 0 where the type is not known.
inline std::size_t componentBytes(std::uint64_t type) {
  if (type == kByte || type == kUnsignedByte) return 1;
  if (type == kShort || type == kUnsignedShort) return 2;
  return type == kUnsignedInt || type == kFloat ? 4 : 0;
}

struct Accessor {
  const std::uint8_t* data = nullptr;
  std::uint64_t count = 0;
  std::size_t stride = 0;
  std::uint64_t component_type = 0;
  std::size_t components = 0;
  bool normalized = false;
  std::shared_ptr<const base::Bytes> owner;  ///< of `data`, where it was decoded; null where it lies in a buffer

  std::size_t elementBytes() const { return componentBytes(component_type) * components; }

  template <class T>
  T load(std::uint64_t i, std::size_t component) const {
    T value;
    std::memcpy(&value, data + i * stride + component * sizeof(T), sizeof(T));
    return value;
  }
  /// A component as a number; normalised integers become −1..1 or 0..1 (section 3.6.2.2).
  double value(std::uint64_t i, std::size_t c) const {
    if (component_type == kFloat) return static_cast<double>(load<float>(i, c));
    if (component_type == kByte) return scaled(load<std::int8_t>(i, c), 127.0);
    if (component_type == kUnsignedByte) return scaled(load<std::uint8_t>(i, c), 255.0);
    if (component_type == kShort) return scaled(load<std::int16_t>(i, c), 32767.0);
    if (component_type == kUnsignedShort) return scaled(load<std::uint16_t>(i, c), 65535.0);
    return static_cast<double>(load<std::uint32_t>(i, c));
  }
  glm::dvec3 vector(std::uint64_t i) const { return {value(i, 0), value(i, 1), value(i, 2)}; }
  /// An element of an unsigned integer type.
  std::uint32_t index(std::uint64_t i) const {
    if (component_type == kUnsignedByte) return load<std::uint8_t>(i, 0);
    if (component_type == kUnsignedShort) return load<std::uint16_t>(i, 0);
    return load<std::uint32_t>(i, 0);
  }
  bool isIndex() const {
    return components == 1 &&
           (component_type == kUnsignedByte || component_type == kUnsignedShort || component_type == kUnsignedInt);
  }

 private:
  double scaled(int raw, double largest) const {
    return normalized ? std::max(static_cast<double>(raw) / largest, -1.0) : static_cast<double>(raw);
  }
};

}  // namespace mesh::gltf
