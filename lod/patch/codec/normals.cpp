#include "lod/patch/codec/normals.h"

#include "lod/patch/codec.h"

namespace lod::patch {

void quantizeNormals(std::span<glm::vec3> normals) {
  using codec::kNormalBlock;
  codec::NormalBlock unit;
  std::array<std::int32_t, kNormalBlock> u, v;
  for (std::size_t first = 0; first < normals.size(); first += kNormalBlock) {
    const std::span<glm::vec3> block = normals.subspan(first, std::min(kNormalBlock, normals.size() - first));
    for (std::size_t i = 0; i < block.size(); ++i)
      unit.x[i] = block[i].x, unit.y[i] = block[i].y, unit.z[i] = block[i].z;
    codec::encodeNormals(unit, block.size(), u.data(), v.data());
    codec::decodeNormals(u.data(), v.data(), block.size(), unit);
    for (std::size_t i = 0; i < block.size(); ++i) block[i] = {unit.x[i], unit.y[i], unit.z[i]};
  }
}

}  // namespace lod::patch
