// Feeds any bytes to SampleTree::decode, as they are and with a correct checksum. An accepted tree must be usable.
#include "repository/sampling/sample_tree.h"

#include "base/check.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/sample_points.h"

namespace {

repository::Grid testGrid() {
  repository::Grid grid;
  grid.count = {17, 6, 9};
  grid.face_size = 64;
  return grid;
}

void decode(base::ByteView bytes) {
  const repository::Grid grid = testGrid();
  const auto tree = repository::SampleTree::decode(grid, bytes);
  if (!tree) return;
  const base::Bytes again = tree->encode(repository::SampleTree::Form{bytes[1]});
  LUMIGRID_CHECK(base::Bytes(bytes.begin(), bytes.end()) == again);
  for (const glm::uvec3& point : tree->points()) LUMIGRID_CHECK(support::hasPoint(*tree, grid, point));
  for (const glm::uvec3& corner : tree->cornersOf(tree->leafOf({15, 4, 7})))
    LUMIGRID_CHECK(grid.contains({corner.x, corner.y, corner.z, 0}));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  repository::SampleTree mixed(testGrid(), 4);
  mixed.split({{4, 0, 4}, 4});
  mixed.close({{0, 4, 0}, 4});
  mixed.leaveOut({16, 5, 8});
  mixed.leaveOut({4, 4, 4});
  return {repository::SampleTree(testGrid(), 16).encode(), repository::SampleTree(testGrid(), 1).encode(),
          mixed.encode(), mixed.encode(repository::SampleTree::Form::kPublished)};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < 4) return;
  decode(withChecksum(bytes));
}

}  // namespace fuzz
