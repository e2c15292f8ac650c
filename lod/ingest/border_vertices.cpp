#include "lod/ingest/border_vertices.h"

namespace lod::ingest {

glm::vec3 VertexSums::unitNormal() const {
  for (const std::int64_t* sum : {normal, face}) {
    const glm::dvec3 n(static_cast<double>(sum[0]), static_cast<double>(sum[1]), static_cast<double>(sum[2]));
    if (const double length = glm::length(n); length > 0.0) return glm::vec3(n / length);
  }
  return {0.0F, 0.0F, 1.0F};
}

glm::u8vec4 VertexSums::meanColor() const {
  if (colored == 0) return glm::u8vec4(255);
  auto mean = [this](int k) { return static_cast<std::uint8_t>((color[k] + colored / 2) / colored); };
  return {mean(0), mean(1), mean(2), 255};
}

}  // namespace lod::ingest
