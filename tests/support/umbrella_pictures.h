#pragma once
// Decodes the leaves of a made pmr.lgm as lod::pmr::Stream would, for tests that draw them.
#include <cmath>
#include <memory>
#include <vector>

#include "lod/pmr/stream.h"
#include "tests/support/made_pmr.h"

namespace support {

inline lod::pmr::Vertex vertexOf(const lod::pmr::CodedPoint& point, const lod::Lattice& lattice) {
  const glm::vec3 normal = lod::pmr::decodeNormal(point.normal);
  lod::pmr::Vertex vertex;
  vertex.position = lattice.position(point.place);
  for (int axis = 0; axis < 3; ++axis)
    vertex.normal[static_cast<std::size_t>(axis)] = static_cast<std::int8_t>(std::lround(127.0F * normal[axis]));
  vertex.color = glm::u8vec4(point.color, 255);
  return vertex;
}

inline std::shared_ptr<lod::pmr::LeafPicture> leafPicture(const MadePmr& made, std::uint32_t leaf,
                                                          std::uint32_t level) {
  auto picture = std::make_shared<lod::pmr::LeafPicture>();
  picture->leaf = leaf;
  picture->level = level;
  const MadePmr::Content& content = made.contents[leaf];
  std::vector<glm::vec3> positions;
  for (std::uint32_t v = 0; v < made.leaves[leaf].verticesAt(level); ++v) {
    picture->vertices.push_back(vertexOf(content.vertices[v], made.header.lattice));
    positions.push_back(picture->vertices.back().position);
  }
  picture->list = lod::pmr::makeDrawList(positions, content.is_own, content.corners[level]);
  return picture;
}

/// All leaves that a view chooses, each at its level.
inline std::vector<lod::pmr::DrawnLeaf> chosenLeaves(const MadePmr& made, const base::Camera& camera,
                                                     float tolerance = 1.0F) {
  std::vector<lod::pmr::ChosenLeaf> chosen;
  lod::pmr::Octree(made.leaves).choose(made.leaves, {.camera = camera, .tolerance = tolerance}, chosen);
  std::vector<lod::pmr::DrawnLeaf> leaves;
  for (const lod::pmr::ChosenLeaf& one : chosen)
    leaves.push_back({one.pixel, one.level, leafPicture(made, one.leaf, one.level)});
  return leaves;
}

}  // namespace support
