// Decodes any bytes as the block of a picture or of a caster, as they are and with the checksum made right. The counts
// are the first bytes' numbers.
#include "base/check.h"
#include "lod/hlod/block.h"
#include "lod/patch/codec/header.h"
#include "lod/pmr/chunk_checksum.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/made_hlod.h"

namespace {

using namespace lod::hlod;

void checkList(const std::vector<NodeVertex>& vertices, const Node& row) {
  for (const NodeVertex& vertex : vertices)
    for (int axis = 0; axis < 3; ++axis)
      LUMIGRID_CHECK(vertex.place[axis] >= 0 && vertex.place[axis] <= kLatticeEnd >> row.step_bits);
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

base::Bytes sealedPatch(base::ByteView bytes) {
  base::Bytes patch(bytes.begin(), bytes.end());
  if (patch.size() < lod::patch::codec::kHeaderBytes) return patch;
  const std::uint32_t crc = lod::patch::codec::checksum(bytes);
  std::memcpy(patch.data() + lod::patch::codec::kCrcOffset, &crc, sizeof(crc));
  return patch;
}

/// Copies the next piece, with the checksum that `seal` gives it.
void sealPiece(base::ByteReader& in, base::ByteWriter& out, const auto& seal) {
  const std::uint64_t length = in.varint();
  const base::ByteView piece = in.bytes(static_cast<std::size_t>(std::min<std::uint64_t>(length, in.remaining())));
  if (piece.size() < sizeof(std::uint32_t)) return;
  const base::Bytes sealed_piece = seal(piece);
  out.varint(sealed_piece.size());
  out.bytes(sealed_piece);
}

/// The block, of one piece of triangles and one of points at most, with all checksums made right.
base::Bytes sealed(base::ByteView block, const Node& row, const BlockOptions& options) {
  base::ByteReader in(block);
  base::ByteWriter out;
  if (row.triangles > 0) sealPiece(in, out, sealedPatch);
  const std::uint32_t points = options.is_caster ? 0 : row.points;
  for (std::uint32_t i = 0; i < (options.is_caster ? 0 : row.edges); ++i) out.varint(in.varint());
  if (points > 0)
    sealPiece(in, out, [&](base::ByteView piece) {
      return lod::pmr::sealedChunk(base::Bytes(piece.begin(), piece.end() - sizeof(std::uint32_t)), points, 0);
    });
  return lod::pmr::sealedChunk(out.takeBytes(), row.triangles, points);
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
  decode(sealed(block, row, options), row, options);
}

}  // namespace fuzz
