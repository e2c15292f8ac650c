// Feeds any bytes to WantedTiles::decode, as they are and with a correct checksum. Accepted tiles are those of the
// grid, with their ancestors.
#include "repository/sampling/wanted_tiles.h"

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace {

repository::Grid testGrid() {
  repository::Grid grid;
  grid.count = {17, 6, 9};
  grid.spacing = 1.0F;
  return repository::withTiles(grid, 3);
}

void decode(base::ByteView bytes) {
  const repository::Grid grid = testGrid();
  const auto wanted = repository::WantedTiles::decode(grid, bytes);
  if (!wanted) return;
  LUMIGRID_CHECK(base::Bytes(bytes.begin(), bytes.end()) == wanted->encode(grid));
  LUMIGRID_CHECK(wanted->count() <= 64 * bytes.size());
  for (const std::uint32_t tile : wanted->ofFace({1, 0, 0, 2}))
    LUMIGRID_CHECK(tile == 0 || wanted->has({1, 0, 0, 2, repository::parentOfTile(tile)}));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<repository::FaceKey> all;
  for (std::uint32_t tile = 0; tile < repository::firstTileOf(4); ++tile) all.push_back({1, 0, 0, 2, tile});
  const repository::WantedTiles few({{1, 0, 0, 2, 30}, {16, 5, 8, 5, 84}});
  return {repository::WantedTiles().encode(testGrid()), few.encode(testGrid()),
          repository::WantedTiles(all).encode(testGrid())};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < 4) return;
  decode(withChecksum(bytes));
}

}  // namespace fuzz
