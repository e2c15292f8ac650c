// Feeds any bytes to Grid::decode. An accepted grid must be usable.
#include "repository/sampling/grid.h"

#include <cmath>

#include "base/check.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {

std::vector<base::Bytes> seeds() {
  base::Aabb model;
  model.add(glm::vec3(-1.0F, -2.0F, 0.0F));
  model.add(glm::vec3(3.0F, 2.0F, 1.0F));
  base::ByteWriter full;
  repository::makeGrid(model, 32, 0.5F, 512).encode(full);
  base::ByteWriter none;
  repository::Grid{}.encode(none);
  return {full.takeBytes(), none.takeBytes()};
}

void fuzzOne(base::ByteView bytes) {
  base::ByteReader in(bytes);
  const auto grid = repository::Grid::decode(in);
  if (!grid) return;
  base::ByteWriter out;
  grid->encode(out);
  base::ByteReader again(out.view());
  const auto same = repository::Grid::decode(again);
  LUMIGRID_CHECK(same && *same == *grid);
  if (grid->pointCount() == 0) return;
  for (const glm::vec3& p : {glm::vec3(0.0F), grid->first, glm::vec3(NAN), glm::vec3(INFINITY), glm::vec3(-1e38F)}) {
    for (const glm::uvec3& corner : grid->cellCorners(p)) {
      LUMIGRID_CHECK(grid->contains({corner.x, corner.y, corner.z, 0}));
      const glm::vec3 place = grid->point(corner.x, corner.y, corner.z);
      LUMIGRID_CHECK(std::isfinite(place.x) && std::isfinite(place.y) && std::isfinite(place.z));
    }
  }
}

}  // namespace fuzz
