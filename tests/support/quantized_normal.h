#pragma once
// One normal as a patch stores it.
#include "lod/patch/codec.h"

namespace support {

inline glm::vec3 quantizedNormal(const glm::vec3& n) {
  glm::vec3 quantized = n;
  lod::patch::quantizeNormals({&quantized, 1});
  return quantized;
}

}  // namespace support
