// Seams are closed, and what only looks like one is not: slits, sheets that lie over each other, borders.
#include "lod/ingest/stitching.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "lod/ingest/level_grid.h"
#include "tests/support/sorted_mesh.h"

namespace {

using namespace lod::ingest;
using support::PlyMesh;
using support::SortedMesh;

constexpr std::uint64_t kMemory = std::uint64_t{64} << 20;

double bump(double x, double y) {
  return 2.0 * std::sin(0.2 * x) * std::cos(0.15 * y);
}

// Adds a sheet of columns x rows quads from (x0, y0) on, each a unit wide; `place` may move its vertices, and `keep`
// leaves quads out.
template <class Place, class Keep>
void addSheet(PlyMesh& mesh, int x0, int y0, int columns, int rows, Place&& place, Keep&& keep) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (int y = 0; y <= rows; ++y)
    for (int x = 0; x <= columns; ++x) mesh.add(place(glm::dvec3(x0 + x, y0 + y, bump(x0 + x, y0 + y))));
  const auto at = [&](int x, int y) { return first + static_cast<std::uint32_t>(y * (columns + 1) + x); };
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      if (!keep(x0 + x, y0 + y)) continue;
      mesh.add(at(x, y), at(x + 1, y), at(x + 1, y + 1));
      mesh.add(at(x, y), at(x + 1, y + 1), at(x, y + 1));
    }
}
glm::dvec3 asItIs(const glm::dvec3& p) {
  return p;
}
bool all(int, int) {
  return true;
}

// A sheet of `side`² quads in tiles of `tile`² quads, each of which has its own grid to which it was rounded.
PlyMesh tiledSheet(int side, int tile, double rounding) {
  PlyMesh mesh;
  std::minstd_rand random(7);
  std::uniform_real_distribution<double> offset(0.0, rounding);
  for (int y = 0; y < side; y += tile)
    for (int x = 0; x < side; x += tile) {
      const glm::dvec3 grid(offset(random), offset(random), offset(random));
      addSheet(
          mesh, x, y, tile, tile,
          [&](const glm::dvec3& p) { return glm::floor((p - grid) / rounding + 0.5) * rounding + grid; }, all);
    }
  return mesh;
}

struct Outcome {
  std::uint64_t open = 0;  // edges in the buckets
  std::uint64_t triangles = 0;
  StitchCounts counts;
};
Outcome sorted(const PlyMesh& mesh, const StitchOptions& stitch = {}) {
  const SortedMesh all(mesh, kMemory, 2, stitch);
  EXPECT_TRUE(all.buckets) << all.buckets.error().message;
  return {all.buckets->winding().openEdges(), all.buckets->totals().triangles, all.buckets->totals().stitched};
}

TEST(Stitching, tilesThatWereRoundedApartBecomeOneSheet) {
  for (const double rounding : {0.02, 0.1, 0.2}) {
    const PlyMesh mesh = tiledSheet(200, 10, rounding);
    const Outcome before = sorted(mesh, {false, 0.0}), after = sorted(mesh);
    EXPECT_GT(before.open, 400U * 36U) << rounding;  // some vertices meet on the lattice
    EXPECT_EQ(after.open, 800U) << "the outline alone, at " << rounding;
    EXPECT_EQ(after.counts.source_edges, before.open);
    EXPECT_EQ(after.triangles, before.triangles);
    // Each inner seam loses the vertices of one side.
    EXPECT_GT(after.counts.stitched_vertices, 19U * 180U * 2U);
    // In lattice steps; where four tiles meet, a vertex goes from one to the next.
    const double steps_per_unit = ((1 << 14) - 2) / 200.0;
    EXPECT_LT(after.counts.largest_movement, 2.0 * (std::sqrt(3.0) * rounding * steps_per_unit + 1.0));
    EXPECT_EQ(after.counts.closed_holes, 0U);
  }
}

TEST(Stitching, partsOfUnlikePaintKeepTheirEdges) {
  PlyMesh mesh = tiledSheet(100, 10, 0.1);
  const std::size_t tile = mesh.positions.size() / 100;
  for (const bool painted : {false, true}) {
    mesh.colors.clear();
    for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
      const glm::dvec3 p = mesh.positions[v];
      const auto shade = static_cast<std::uint8_t>(128.0 + 60.0 * std::sin(0.3 * p.x + 0.2 * p.y));
      const auto paint = static_cast<std::uint8_t>(v / tile * 97 % 256);
      mesh.colors.emplace_back(painted ? glm::u8vec4(paint, 255 - paint, 40, 255) : glm::u8vec4(shade, 90, 40, 255));
    }
    const Outcome after = sorted(mesh);
    // Neighbours to the right differ by 97 levels, those above by 202 or 54.
    EXPECT_EQ(after.open, painted ? 4000U : 400U) << painted;
  }
}

TEST(Stitching, aLengthIsKeptTo) {
  const PlyMesh mesh = tiledSheet(60, 10, 0.2);
  const Outcome found = sorted(mesh), none = sorted(mesh, {true, 1e-4}), wide = sorted(mesh, {true, 0.4});
  EXPECT_EQ(found.open, 240U);
  EXPECT_GT(none.open, 1000U);
  EXPECT_EQ(wide.open, 240U);
}

TEST(Stitching, aCombKeepsEverySlitOfHalfAnEdge) {
  PlyMesh mesh;
  // Teeth of four quads, half a unit apart, on a back that has their vertices.
  for (int tooth = 0; tooth < 40; ++tooth)
    addSheet(
        mesh, 4 * tooth, 0, 4, 60, [&](const glm::dvec3& p) { return p + glm::dvec3(0.5 * tooth, 0.0, 0.0); }, all);
  const Outcome before = sorted(mesh, {false, 0.0}), after = sorted(mesh);
  EXPECT_EQ(before.open, 40U * 128U);
  EXPECT_EQ(after.open, before.open);
  EXPECT_EQ(after.counts.stitched_vertices, 0U);
  // Beside true seams as well.
  for (int tile = 0; tile < 20; ++tile)
    addSheet(
        mesh, 10 * tile, 100, 10, 10,
        [&](const glm::dvec3& p) { return p + glm::dvec3(0.0, 0.04 * (tile % 2), 0.03 * (tile % 3)); }, all);
  const Outcome both = sorted(mesh);
  EXPECT_EQ(both.open, before.open + 2U * 200U + 2U * 10U);
  EXPECT_LE(both.counts.stitched_vertices, 19U * 11U);
}

TEST(Stitching, sheetsThatLieOverEachOtherStayTwo) {
  for (const double apart : {0.1, 0.3}) {
    PlyMesh mesh;
    for (const double z : {0.0, apart})
      addSheet(
          mesh, 0, 0, 50, 50, [&](const glm::dvec3& p) { return p + glm::dvec3(0.0, 0.0, z); }, all);
    const Outcome after = sorted(mesh);
    EXPECT_EQ(after.open, 400U) << apart;
    EXPECT_EQ(after.counts.stitched_vertices, 0U) << apart;
    EXPECT_EQ(after.counts.split_edges, 0U) << apart;
  }
}

TEST(Stitching, aVertexOnAnotherBordersEdgeSplitsIt) {
  PlyMesh mesh;
  addSheet(mesh, 0, 0, 40, 20, asItIs, all);
  // The other side of the seam is twice as fine.
  addSheet(
      mesh, 0, 0, 80, 20,
      [](const glm::dvec3& p) {
        const double x = 0.5 * p.x;
        const double low = std::floor(x), share = x - low;
        const double seam = (1.0 - share) * bump(low, 20.0) + share * bump(low + 1.0, 20.0);
        return glm::dvec3(x, 20.0 + 0.5 * p.y, p.y == 0.0 ? seam + 0.02 : bump(x, 20.0 + 0.5 * p.y));
      },
      all);
  const Outcome before = sorted(mesh, {false, 0.0}), after = sorted(mesh);
  EXPECT_EQ(before.open, 120U + 200U);
  EXPECT_EQ(after.open, 40U + 2U * 20U + 80U + 2U * 20U);
  EXPECT_EQ(after.counts.split_edges, 40U);
  EXPECT_EQ(after.triangles, before.triangles + 40U);
}

TEST(Stitching, theSmallestHolesAreClosedAndLargerOnesKept) {
  PlyMesh mesh;
  // A quad is missing, and a strip of six.
  addSheet(mesh, 0, 0, 900, 20, asItIs,
           [](int x, int y) { return !(x == 5 && y == 5) && !(y == 10 && x >= 30 && x < 36); });
  const Outcome after = sorted(mesh);
  EXPECT_EQ(after.counts.closed_holes, 1U);
  EXPECT_EQ(after.triangles, 2U * (900U * 20U - 6U));
  EXPECT_EQ(after.open, 1840U + 14U);
}

TEST(Stitching, aTriangleByItselfIsNoHole) {
  PlyMesh mesh;
  addSheet(mesh, 0, 0, 400, 4, asItIs, all);
  for (int i = 0; i < 300; ++i) {
    const double x = 1.3 * i;
    const std::uint32_t a = mesh.add({x, 50.0, 0.0});
    mesh.add({x + 1.0, 50.0, 0.0});
    mesh.add({x, 51.0, 0.0});
    mesh.add(a, a + 1, a + 2);
  }
  const Outcome after = sorted(mesh);
  EXPECT_EQ(after.counts.closed_holes, 0U);
  EXPECT_EQ(after.open, 808U + 900U);
}

TEST(Stitching, leavesThatLieAboutAreNoSeams) {
  PlyMesh mesh;
  std::minstd_rand random(11);
  std::uniform_real_distribution<double> place(0.0, 12.0), turn(-1.0, 1.0);
  for (int i = 0; i < 8000; ++i) {
    const glm::dvec3 p(place(random), place(random), place(random));
    const glm::dvec3 u = glm::normalize(glm::dvec3(turn(random), turn(random), turn(random) + 2.0));
    const glm::dvec3 v = glm::normalize(glm::cross(u, glm::dvec3(turn(random), 1.0, turn(random))));
    const std::uint32_t a = mesh.add(p);
    mesh.add(p + u), mesh.add(p + v);
    mesh.add(a, a + 1, a + 2);
  }
  EXPECT_EQ(sorted(mesh).counts.stitched_vertices, 0U);
}

std::multiset<std::array<std::uint64_t, 3>> trianglesOf(const SortedMesh& sorted) {
  std::multiset<std::array<std::uint64_t, 3>> all;
  for (std::size_t bucket = 0; bucket < sorted.buckets->count(); ++bucket) {
    const auto corners = sorted.buckets->read(bucket);
    for (std::size_t i = 0; i < corners->size(); i += 3)
      all.insert({(*corners)[i].code, (*corners)[i + 1].code, (*corners)[i + 2].code});
  }
  return all;
}

TEST(Stitching, neitherThreadsNorMemoryNorTheOrderOfTrianglesMatter) {
  PlyMesh mesh = tiledSheet(400, 20, 0.15);
  const SortedMesh first(mesh, kMemory, 2, {});
  ASSERT_TRUE(first.buckets) << first.buckets.error().message;
  ASSERT_GT(first.buckets->count(), 1U);
  const auto triangles = trianglesOf(first);
  // The vertices' window of the second is a part of them.
  const SortedMesh tight(mesh, std::uint64_t{9} << 20, 1, {});
  ASSERT_TRUE(tight.buckets) << tight.buckets.error().message;
  EXPECT_EQ(trianglesOf(tight), triangles);
  std::vector<std::array<std::uint32_t, 3>> shuffled;
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
    shuffled.push_back({mesh.indices[i], mesh.indices[i + 1], mesh.indices[i + 2]});
  std::shuffle(shuffled.begin(), shuffled.end(), std::minstd_rand(5));
  mesh.indices.clear();
  for (const auto& t : shuffled) mesh.add(t[0], t[1], t[2]);
  EXPECT_EQ(trianglesOf(SortedMesh(mesh, kMemory, 2, {})), triangles);
}

TEST(Stitching, aBorderThatDoesNotFitTheMemoryIsStitchedInSlabs) {
  PlyMesh mesh = tiledSheet(200, 4, 0.1);
  // Vertices on others' edges, across the slabs, and small holes.
  addSheet(
      mesh, 0, -100, 200, 25, [](const glm::dvec3& p) { return glm::dvec3(p.x, 4.0 * p.y + 300.0, p.z); }, all);
  for (int x = 5; x < 200; x += 10)
    addSheet(
        mesh, x, 220, 6, 6,
        [](const glm::dvec3& p) { return 0.25 * glm::dvec3(p.x, p.y, 0.0) + glm::dvec3(0.0, 400.0, 0.0); },
        [&](int column, int row) { return column != x + 3 || row != 223; });
  const SortedMesh roomy(mesh, kMemory, 2, {}), tight(mesh, std::uint64_t{2} << 20, 2, {});
  ASSERT_TRUE(roomy.buckets && tight.buckets);
  const StitchCounts one = roomy.buckets->totals().stitched, several = tight.buckets->totals().stitched;
  EXPECT_EQ(one.slabs, 1U);
  EXPECT_GT(several.slabs, 3U);
  EXPECT_GT(one.closed_holes, 10U);
  EXPECT_EQ(several.source_edges, one.source_edges);
  EXPECT_EQ(several.reach, one.reach);
  EXPECT_EQ(several.largest_movement, one.largest_movement);
  EXPECT_EQ(trianglesOf(tight), trianglesOf(roomy));
}

TEST(Stitching, aBorderTooDenseForTheMemoryIsLeftAndSaid) {
  const PlyMesh mesh = tiledSheet(200, 4, 0.1);
  const SortedMesh tight(mesh, std::uint64_t{1} << 18, 1, {});
  ASSERT_TRUE(tight.buckets) << tight.buckets.error().message;
  EXPECT_EQ(tight.buckets->totals().stitched.too_many, 1U);
  EXPECT_EQ(tight.buckets->winding().openEdges(), sorted(mesh, {false, 0.0}).open);
}

TEST(Stitching, optionsAreParsedAndDescribed) {
  for (const char* text : {"auto", "off", "0.25", "1e-06"}) {
    const auto options = parseStitch(text);
    ASSERT_TRUE(options) << text;
    EXPECT_EQ(describeStitch(*options), text);
  }
  for (const char* text : {"", "on", "-1", "0", "nan", "inf", "1 m", "0x3"}) EXPECT_FALSE(parseStitch(text)) << text;
}

TEST(LevelGrid, findsAllThatIsNear) {
  std::minstd_rand random(3);
  std::vector<glm::ivec3> points;
  std::vector<float> sizes;
  for (int i = 0; i < 3000; ++i) {
    const int span = i % 3 == 0 ? 2'000'000 : 3000;
    points.emplace_back(random() % span, random() % span, random() % span);
    sizes.push_back(std::exp2(static_cast<float>(random() % 1800) / 100.0F) * 0.7F);
  }
  const LevelGrid grid(points, sizes);
  for (std::uint32_t i = 0; i < points.size(); i += 17) {
    std::set<std::uint32_t> found;
    grid.near(
        points[i], LevelGrid::levelOf(sizes[i]), [&](float) { return sizes[i]; },
        [&](std::uint32_t j) { EXPECT_TRUE(found.insert(j).second); });
    for (std::uint32_t j = 0; j < points.size(); ++j) {
      const glm::ivec3 apart = glm::abs(points[j] - points[i]);
      const bool near = static_cast<float>(std::max({apart.x, apart.y, apart.z})) <= sizes[i];
      if (!near || LevelGrid::levelOf(sizes[j]) < LevelGrid::levelOf(sizes[i])) continue;
      EXPECT_TRUE(found.count(j)) << i << ' ' << j;
    }
  }
}

}  // namespace
