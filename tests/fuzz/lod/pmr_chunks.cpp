// Decodes any bytes as chunks of points and of triangles, as they are and with their checksums made right. The counts
// are the first bytes' numbers.
#include "base/check.h"
#include "lod/pmr/chunk_checksum.h"
#include "lod/pmr/chunks.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/made_pmr.h"

namespace {

using namespace lod::pmr;

constexpr std::int32_t kLast = (1 << kPositionBits) - 1;

const support::MadePmr& made() {
  static const support::MadePmr file = support::madePmr(96, true, 400);
  return file;
}

/// The vertices that triangles are decoded for.
std::vector<glm::ivec3> places(std::size_t count) {
  std::vector<glm::ivec3> places;
  for (const CodedPoint& point : made().contents[0].vertices)
    if (places.size() < count) places.push_back(point.place);
  return places;
}

void decodePointChunk(base::ByteView chunk, std::uint32_t own, std::uint32_t foreign, bool colors) {
  std::vector<CodedPoint> points(1);
  if (!decodePoints(chunk, own, foreign, colors, points)) {
    LUMIGRID_CHECK_EQ(points.size(), 1U);
    return;
  }
  LUMIGRID_CHECK_EQ(points.size(), std::size_t{1} + own + foreign);
  for (const CodedPoint& point : points)
    for (int axis = 0; axis < 3; ++axis) LUMIGRID_CHECK(point.place[axis] >= 0 && point.place[axis] <= kLast);
}

void decodeTriangleChunk(base::ByteView chunk, std::uint32_t triangles, const std::vector<glm::ivec3>& vertices) {
  const auto corners = decodeTriangles(chunk, triangles, vertices);
  if (!corners) return;
  LUMIGRID_CHECK_EQ(corners->size(), std::size_t{3} * triangles);
  for (std::size_t i = 0; i < corners->size(); i += 3) {
    const std::uint16_t a = (*corners)[i], b = (*corners)[i + 1], c = (*corners)[i + 2];
    LUMIGRID_CHECK(a != b && b != c && c != a);
    LUMIGRID_CHECK(a < vertices.size() && b < vertices.size() && c < vertices.size());
  }
}

/// Three bytes of counts, then a chunk.
base::Bytes seed(std::uint8_t kind, std::uint32_t first, std::uint32_t second, base::ByteView chunk) {
  base::ByteWriter out;
  out.u8(kind);
  out.u16(static_cast<std::uint16_t>(first));
  out.u16(static_cast<std::uint16_t>(second));
  out.bytes(chunk);
  return out.takeBytes();
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  const Leaf& leaf = made().leaves[0];
  for (const std::uint32_t level : {0U, 4U, 7U}) {
    const LevelRow& row = leaf.levels[level];
    const base::ByteView file(made().file);
    all.push_back(seed(0, row.points, row.foreign, file.subspan(row.point_offset, row.point_bytes)));
    all.push_back(
        seed(2, row.triangles, leaf.verticesAt(level), file.subspan(row.triangle_offset, row.triangle_bytes)));
  }
  // All triangles of few vertices are coded as a list.
  std::vector<std::uint16_t> corners;
  for (std::uint16_t a = 0; a < 30; ++a)
    for (std::uint16_t b = 0; b < a; ++b)
      if ((a + b) % 3 != 0 && a != 1) corners.insert(corners.end(), {a, b, static_cast<std::uint16_t>(30 + a)});
  all.push_back(seed(2, static_cast<std::uint32_t>(corners.size() / 3), 100, encodeTriangles(corners, places(100))));
  return all;
}

void fuzzOne(base::ByteView bytes) {
  base::ByteReader in(bytes);
  const std::uint32_t kind = in.u8() % 4;
  const std::uint32_t first = in.u16(), second = in.u16();
  const base::ByteView chunk = in.bytes(in.remaining());
  if (kind < 2) {
    const std::uint32_t own = first % 2000, foreign = second % 500;
    decodePointChunk(chunk, own, foreign, kind == 0);
    decodePointChunk(sealedChunk(base::Bytes(chunk.begin(), chunk.end()), own, foreign), own, foreign, kind == 0);
    return;
  }
  const std::vector<glm::ivec3> vertices = places(second % 1000);
  const std::uint32_t triangles = first % 4000;
  decodeTriangleChunk(chunk, triangles, vertices);
  decodeTriangleChunk(
      sealedChunk(base::Bytes(chunk.begin(), chunk.end()), triangles, static_cast<std::uint32_t>(vertices.size())),
      triangles, vertices);
}

}  // namespace fuzz
