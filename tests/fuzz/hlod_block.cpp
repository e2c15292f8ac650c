// Decodes any bytes as the block of a picture or of a caster, as they are and with the checksum made right. The counts
// are the first bytes' numbers.
#include "base/check.h"
#include "lod/hlod/block.h"
#include "lod/pmr/chunk_checksum.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/made_hlod.h"

namespace {

using namespace lod::hlod;

void checkList(const std::vector<NodeVertex>& vertices, const Node& row) {
  for (const NodeVertex& vertex : vertices)
    for (int axis = 0; axis < 3; ++axis)
      LUMIGRID_CHECK(vertex.place[axis] >= 0 && vertex.place[axis] < (1 << kPositionBits) >> row.step_bits);
}

void decode(base::ByteView block, const Node& row, const BlockOptions& options) {
  const auto geometry = decodeBlock(block, row, options);
  if (!geometry) return;
  LUMIGRID_CHECK(isIntact(block, row, options));
  LUMIGRID_CHECK_EQ(geometry->triangles.size(), std::size_t{3} * row.triangles);
  LUMIGRID_CHECK_EQ(geometry->points.size(), options.is_caster ? 0 : row.points);
  LUMIGRID_CHECK_EQ(geometry->edges.size(), options.is_caster ? 0 : std::size_t{2} * row.edges);
  for (const auto* list : {&geometry->triangles, &geometry->edges})
    for (const std::uint32_t vertex : *list) LUMIGRID_CHECK_LT(vertex, geometry->vertices.size());
  checkList(geometry->vertices, row);
  checkList(geometry->points, row);
}

/// A kind, counts, then a block.
base::Bytes seed(std::uint8_t kind, const Node& row, std::uint32_t triangles, base::ByteView block) {
  base::ByteWriter out;
  out.u8(kind);
  out.u8(row.step_bits);
  out.u16(static_cast<std::uint16_t>(triangles));
  out.u16(static_cast<std::uint16_t>(row.points));
  out.u16(static_cast<std::uint16_t>(row.edges));
  out.bytes(block);
  return out.takeBytes();
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const bool colors : {true, false}) {
    const support::MadeHlod made = support::madeHlod(1, 8, colors);
    for (const std::size_t number : {std::size_t{0}, made.nodes.size() - 1}) {
      const Node& node = made.nodes[number];
      const auto part = [&](const BlockPlace& place) {
        return base::ByteView(made.file).subspan(place.offset, place.bytes);
      };
      all.push_back(seed(colors ? 0 : 1, node, node.triangles, part(node.picture)));
      if (!node.isLeaf()) all.push_back(seed(2, node, node.caster_triangles, part(node.caster)));
    }
  }
  return all;
}

void fuzzOne(base::ByteView bytes) {
  base::ByteReader in(bytes);
  const std::uint32_t kind = in.u8() % 3;
  Node row;
  row.step_bits = in.u8() % kPositionBits;
  row.triangles = row.caster_triangles = in.u16() % 4000;
  row.points = in.u16() % 4000;
  row.edges = in.u16() % 4000;
  const BlockOptions options{kind == 0, kind == 2};
  const base::ByteView block = in.bytes(in.remaining());
  decode(block, row, options);
  decode(
      lod::pmr::sealedChunk(base::Bytes(block.begin(), block.end()), row.triangles, options.is_caster ? 0 : row.points),
      row, options);
}

}  // namespace fuzz
