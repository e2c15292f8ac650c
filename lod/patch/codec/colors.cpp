#include "lod/patch/codec/colors.h"

#include "lod/patch/codec.h"

namespace lod::patch {

glm::u8vec4 quantizedColor(const glm::u8vec4& color) {
  const auto channel = [](std::uint8_t c) { return codec::byteOfLevel(codec::kLevelOfByte[c]); };
  return {channel(color.r), channel(color.g), channel(color.b), color.a};
}

}  // namespace lod::patch
