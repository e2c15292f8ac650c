// decodePatch on any bytes: as they are, and with their checksum made right.
#include <random>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/patch/codec.h"
#include "tests/fuzz/fuzz.h"
#include "tests/lod/patch/patch_testing.h"

namespace {

using lod::patch::PatchGeometry;

PatchGeometry drawnPatch(int side, int extent, bool colors) {
  std::mt19937 random(static_cast<unsigned>(side));
  PatchGeometry g;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      g.positions.emplace_back(x * extent, y * extent, random() % 50);
      g.normals.emplace_back(static_cast<float>(random() % 7) - 3.0F, 1.0F, 3.0F);
      if (colors)
        g.colors.push_back(
            glm::u8vec4(random() % 256, random() % 256, random() % 256, side % 2 == 1 ? random() % 256 : 255));
    }
  for (int y = 0; y + 1 < side; ++y)
    for (int x = 0; x + 1 < side; ++x)
      for (const int corner : {0, 1, side + 1, 0, side + 1, side})
        g.indices.push_back(static_cast<std::uint16_t>(y * side + x + corner));
  return g;
}

// Positions are multiples of 32, but for every third vertex.
PatchGeometry coarsePatch(int side, bool colors) {
  PatchGeometry g = drawnPatch(side, 40, colors);
  for (std::size_t v = 0; v < g.positions.size(); ++v) g.positions[v] = 32 * g.positions[v] + (v % 3 == 1 ? 5 : 0);
  return g;
}

void decode(base::ByteView bytes) {
  const auto decoded = lod::patch::decodePatch(bytes);
  if (!decoded) return;
  // encodePatch stops on anything that breaks the promises: indices, lattice, counts.
  const auto again = lod::patch::decodePatch(lod::patch::encodePatch(*decoded));
  LUMIGRID_CHECK(static_cast<bool>(again));
  LUMIGRID_CHECK_EQ(again->indices.size(), decoded->indices.size());
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  using lod::patch::encodePatch;
  return {encodePatch(drawnPatch(4, 100, false)), encodePatch(drawnPatch(9, 100'000, true)),
          encodePatch(drawnPatch(20, 7, true)),   encodePatch(patch_testing::tornGrid()),
          encodePatch(coarsePatch(6, true)),      encodePatch(coarsePatch(11, false))};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < 32) return;
  base::Bytes sealed(bytes.begin(), bytes.end());
  const std::uint32_t crc = base::crc32c(bytes.subspan(32), base::crc32c(bytes.first(28)));
  std::memcpy(sealed.data() + 28, &crc, sizeof(crc));
  decode(sealed);
}

}  // namespace fuzz
