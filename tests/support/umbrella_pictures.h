#pragma once
// Decodes the leaves of a made pmr.lgm as lod::pmr::Stream would, for tests that draw them.
#include <memory>
#include <vector>

#include "lod/pmr/leaf_picture.h"
#include "tests/support/made_pmr.h"

namespace support {

inline std::shared_ptr<const lod::pmr::LeafPicture> leafPicture(const MadePmr& made, std::uint32_t leaf,
                                                                std::uint32_t level) {
  const lod::pmr::Leaf& row = made.leaves[leaf];
  return lod::pmr::decodeLeaf(made.header, row, leaf, level,
                              [&](std::uint32_t chunk) {
                                const lod::pmr::ChunkPlace place = lod::pmr::placeOf(row, chunk);
                                return std::optional(base::ByteView(made.file).subspan(place.offset, place.bytes));
                              })
      .picture;
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
