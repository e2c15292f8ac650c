// Triangles come out of their buckets alike, however much memory there was and whichever run asks.
#include "lod/build/buckets.h"

#include <gtest/gtest.h>

#include <random>

#include "lod/build/source_import.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::build;

// A bent sheet of side² quads, a third of its triangles turned over, without pattern.
Mesh turnedSheet(std::uint32_t side) {
  Mesh mesh;
  for (std::uint32_t y = 0; y <= side; ++y)
    for (std::uint32_t x = 0; x <= side; ++x)
      mesh.positions.emplace_back(x, y, 20.0F * std::sin(0.02F * static_cast<float>(x + 2 * y)));
  std::minstd_rand random(3);
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const std::uint32_t a = y * (side + 1) + x, b = a + side + 1;
      for (const std::array<std::uint32_t, 3> t : {std::array{a, a + 1, b}, std::array{a + 1, b + 1, b}}) {
        const bool turned = random() % 3 == 0;
        mesh.indices.insert(mesh.indices.end(), {t[0], turned ? t[2] : t[1], turned ? t[1] : t[2]});
      }
    }
  return mesh;
}

struct Sorted {
  support::TemporaryDirectory scratch;
  base::Result<Buckets> buckets = base::Error{base::ErrorCode::kIo, "not sorted"};

  Sorted(const Mesh& mesh, std::uint64_t memory, unsigned threads) {
    auto directory = WorkDirectory::open(scratch.path(), {});
    const auto input = sourceFromMesh(mesh);
    const auto source = importSource(*directory, *input, 2);
    const SourceLattice lattice = makeLattice(source->info, source->origin, 0);
    buckets = sortSource(*directory, *source, lattice, {memory, threads, {}});
  }
};

void expectSame(const Buckets& a, const Buckets& b) {
  ASSERT_EQ(a.count(), b.count());
  ASSERT_EQ(a.border().codes, b.border().codes);
  for (std::size_t i = 0; i < a.border().sums.size(); ++i)
    for (int k = 0; k < 3; ++k) ASSERT_EQ(a.border().sums[i].face[k], b.border().sums[i].face[k]);
  for (std::size_t bucket = 0; bucket < a.count(); ++bucket) {
    const auto x = a.read(bucket), y = b.read(bucket);
    ASSERT_TRUE(x && y);
    ASSERT_EQ(x->size(), y->size());
    for (std::size_t i = 0; i < x->size(); ++i) ASSERT_EQ((*x)[i].code, (*y)[i].code);
  }
}

TEST(Buckets, NeitherMemoryNorThreadsDecideWhichTrianglesAreTurned) {
  const Mesh mesh = turnedSheet(500);
  const Sorted roomy(mesh, std::uint64_t{64} << 20, 2);
  ASSERT_TRUE(roomy.buckets) << roomy.buckets.error().message;
  ASSERT_GT(roomy.buckets->count(), 1U);
  EXPECT_GT(roomy.buckets->winding().flipped(), mesh.triangleCount() / 4);
  // All look up, but for a triangle at a corner of the sheet, which has one neighbour only.
  std::size_t down = 0;
  for (std::size_t bucket = 0; bucket < roomy.buckets->count(); ++bucket) {
    const auto corners = roomy.buckets->read(bucket);
    ASSERT_TRUE(corners);
    for (std::size_t i = 0; i < corners->size(); i += 3) {
      const Corner* c = &(*corners)[i];
      down += latticeNormal(mortonPoint(c[0].code), mortonPoint(c[1].code), mortonPoint(c[2].code)).z < 0 ? 1 : 0;
    }
  }
  EXPECT_LE(down, 4U);
  // Too little to remember what each triangle is part of.
  const Sorted tight(mesh, std::uint64_t{1} << 20, 1);
  ASSERT_TRUE(tight.buckets) << tight.buckets.error().message;
  expectSame(*roomy.buckets, *tight.buckets);
}

TEST(Buckets, ALaterRunReadsThemAsTheFirstOne) {
  const Sorted first(turnedSheet(400), std::uint64_t{64} << 20, 2);
  ASSERT_TRUE(first.buckets) << first.buckets.error().message;
  const auto later = Buckets::open(first.scratch.path(), first.buckets->state());
  ASSERT_TRUE(later) << later.error().message;
  expectSame(*first.buckets, *later);
}

TEST(Buckets, BorderTrianglesAreThoseThatReadFindsAtTheBorder) {
  for (const bool later : {false, true}) {
    const Sorted sorted(turnedSheet(400), std::uint64_t{64} << 20, 2);
    ASSERT_TRUE(sorted.buckets);
    const auto opened = Buckets::open(sorted.scratch.path(), sorted.buckets->state());
    const Buckets& buckets = later ? *opened : *sorted.buckets;
    std::size_t found = 0;
    for (std::size_t bucket = 0; bucket < buckets.count(); ++bucket) {
      const auto corners = buckets.read(bucket);
      const auto triangles = buckets.borderTriangles(bucket);
      ASSERT_TRUE(corners && triangles);
      auto next = triangles->begin();
      for (std::uint32_t t = 0; 3 * std::size_t{t} < corners->size(); ++t) {
        const Corner* c = &(*corners)[3 * std::size_t{t}];
        std::int64_t at[3];
        for (int k = 0; k < 3; ++k) at[k] = buckets.border().find(c[k].code);
        if (std::max({at[0], at[1], at[2]}) < 0) continue;
        ASSERT_NE(next, triangles->end());
        ASSERT_EQ(next->triangle, t);
        for (int k = 0; k < 3; ++k) {
          ASSERT_EQ(next->corner[k].code, c[k].code);
          ASSERT_EQ(next->place[k], at[k] < 0 ? kNotOnBorder : static_cast<std::uint32_t>(at[k]));
        }
        ++next, ++found;
      }
      EXPECT_EQ(next, triangles->end());
    }
    EXPECT_GT(found, 300U);
  }
}

}  // namespace
