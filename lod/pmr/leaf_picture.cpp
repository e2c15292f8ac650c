#include "lod/pmr/leaf_picture.h"

#include <utility>

#include "lod/pmr/chunk_checksum.h"
#include "lod/pmr/chunks.h"

namespace lod::pmr {
ChunkPlace placeOf(const Leaf& leaf, std::uint32_t chunk) {
  const LevelRow& row = leaf.levels[chunk % kLevels];
  return chunk < kLevels ? ChunkPlace{row.point_offset, row.point_bytes}
                         : ChunkPlace{row.triangle_offset, row.triangle_bytes};
}

bool isIntact(const Leaf& leaf, std::uint32_t chunk, base::ByteView bytes) {
  const LevelRow& row = leaf.levels[chunk % kLevels];
  if (chunk < kLevels) return intactChunk(bytes, row.points, row.foreign).has_value();
  return row.triangles == 0 ? bytes.empty()
                            : intactChunk(bytes, row.triangles, leaf.verticesAt(chunk - kLevels)).has_value();
}

std::uint64_t pictureBytes(const Leaf& leaf, std::uint32_t level) {
  return sizeof(LeafPicture) + leaf.verticesAt(level) * sizeof(Vertex) +
         std::uint64_t{leaf.pointsAt(level)} * (sizeof(std::uint16_t) + sizeof(float)) +
         std::uint64_t{leaf.levels[level].triangles} * 3 * sizeof(std::uint16_t);
}

DecodedLeaf decodeLeaf(const Header& header, const Leaf& leaf, std::uint32_t number, std::uint32_t level,
                       const ChunkBytes& bytes_of) {
  std::vector<CodedPoint> points;
  points.reserve(leaf.verticesAt(level));
  std::vector<bool> is_own;
  for (std::uint32_t c = kLevels; c-- > level;) {
    const LevelRow& row = leaf.levels[c];
    const auto chunk = bytes_of(c);
    if (!chunk || !decodePoints(*chunk, row.points, row.foreign, header.colors, points)) return {nullptr, c};
    is_own.resize(points.size() - row.foreign, true);
    is_own.resize(points.size(), false);
  }

  std::vector<glm::ivec3> places;
  std::vector<glm::vec3> positions;
  auto picture = std::make_shared<LeafPicture>();
  picture->leaf = number;
  picture->level = level;
  places.reserve(points.size());
  positions.reserve(points.size());
  picture->vertices.reserve(points.size());
  for (const CodedPoint& point : points) {
    places.push_back(point.place);
    picture->vertices.push_back(
        surfaceVertex(header.lattice.position(point.place), decodeNormal(point.normal), point.color));
    positions.push_back(picture->vertices.back().position);
  }
  const auto chunk = bytes_of(kLevels + level);
  if (!chunk) return {nullptr, kLevels + level};
  auto corners = decodeTriangles(*chunk, leaf.levels[level].triangles, places);
  if (!corners) return {nullptr, kLevels + level};
  picture->list = makeDrawList(positions, is_own, std::move(*corners));
  return {std::move(picture), 0};
}

}  // namespace lod::pmr
