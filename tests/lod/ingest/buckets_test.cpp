// Buckets give the same triangles whatever the memory, and in a later run.
#include "lod/ingest/buckets.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>

#include "base/file.h"
#include "tests/support/sorted_mesh.h"

namespace {

using namespace lod::ingest;
using support::Mesh;
using support::SortedMesh;

constexpr StitchOptions kUnstitched{false, 0.0};

// Returns a bent sheet of side² quads with a random third of its triangles flipped.
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

void expectSame(const Buckets& a, const Buckets& b) {
  ASSERT_EQ(a.count(), b.count());
  ASSERT_EQ(a.border().codes, b.border().codes);
  for (std::size_t i = 0; i < a.border().sums.size(); ++i) {
    const FacetSums& first = a.border().sums[i].facets;
    const FacetSums& second = b.border().sums[i].facets;
    ASSERT_EQ(first.by_area, second.by_area);
    ASSERT_EQ(first.by_angle, second.by_angle);
    ASSERT_EQ(first.angle, second.angle);
  }
  for (std::size_t bucket = 0; bucket < a.count(); ++bucket) {
    const auto x = a.read(bucket), y = b.read(bucket);
    ASSERT_TRUE(x && y);
    ASSERT_EQ(x->size(), y->size());
    for (std::size_t i = 0; i < x->size(); ++i) ASSERT_EQ((*x)[i].code, (*y)[i].code);
  }
}

// The mean of triangles around their common first corner.
FacetSums around(const std::vector<std::array<glm::ivec3, 3>>& triangles) {
  FacetSums sums;
  for (const auto& [a, b, c] : triangles) sums += facetAtCorners(a, b, c)[0];
  return sums;
}

TEST(FacetSums, leanFromTheSidesOfAnEdgeAlikeWhateverTheirSizes) {
  // A side of 2000 x 2000 in two triangles, of which one is cut in two again, and one of 2000 x 3.
  const glm::ivec3 o(0), x(2000, 0, 0), y(0, 2000, 0), z(0, 0, 3);
  const FacetSums edge =
      around({{o, x, x + y}, {o, x + y, y + x / 2}, {o, y + x / 2, y}, {o, x + z, x}, {o, z, x + z}});
  EXPECT_TRUE(edge.isHard());
  const glm::dvec3 mean = glm::normalize(edge.mean());
  EXPECT_NEAR(mean.x, 0.0, 1e-5);
  EXPECT_NEAR(mean.y, std::sqrt(0.5), 1e-5);
  EXPECT_NEAR(mean.z, std::sqrt(0.5), 1e-5);
}

TEST(FacetSums, goByAreaWhereTheSurfaceBendsLittle) {
  const glm::ivec3 o(0), x(100, 0, 0), y(0, 100, 0), bent(-50, 0, -20);
  const FacetSums curve = around({{o, x, y}, {o, y, bent}});
  EXPECT_FALSE(curve.isHard());
  EXPECT_EQ(curve.mean(), glm::dvec3(glm::i64vec3(0, 0, 10'000) + latticeNormal(o, y, bent)));
}

TEST(FacetSums, angleOfIsThatOfTheArcTangent) {
  for (int degrees = 0; degrees <= 180; ++degrees) {
    const double angle = glm::radians(static_cast<double>(degrees));
    EXPECT_NEAR(angleOf(3.0 * std::abs(std::sin(angle)), 3.0 * std::cos(angle)), angle, 2e-5) << degrees;
  }
}

TEST(FacetSums, ofTrianglesWithoutAreaOrThatCancelAreNone) {
  const glm::ivec3 o(0), x(100, 0, 0), y(0, 100, 0);
  EXPECT_EQ(around({{o, x, x + x}}).mean(), glm::dvec3(0.0));
  const FacetSums both = around({{o, x, y}, {o, y, x}});
  EXPECT_FALSE(both.isHard());
  EXPECT_EQ(both.mean(), glm::dvec3(0.0));
}

TEST(Buckets, flipsDoNotDependOnMemoryOrThreads) {
  const Mesh mesh = turnedSheet(500);
  const SortedMesh roomy(mesh, std::uint64_t{64} << 20, 2, kUnstitched);
  ASSERT_TRUE(roomy.buckets) << roomy.buckets.error().message;
  ASSERT_GT(roomy.buckets->count(), 1U);
  EXPECT_GT(roomy.buckets->winding().flipped(), mesh.triangleCount() / 4);
  // All triangles face up, but those at a corner of the sheet may not, as they have only one neighbour.
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
  // This memory is too little to keep the part of each triangle.
  const SortedMesh tight(mesh, std::uint64_t{1} << 20, 1, kUnstitched);
  ASSERT_TRUE(tight.buckets) << tight.buckets.error().message;
  expectSame(*roomy.buckets, *tight.buckets);
}

TEST(Buckets, aTwoSidedMeshIsTheSameAsItsFront) {
  const Mesh front = turnedSheet(400);
  Mesh both = front;
  for (std::size_t i = 0; i < front.indices.size(); i += 3)
    both.indices.insert(both.indices.end(), {front.indices[i + 1], front.indices[i], front.indices[i + 2]});
  for (const bool stitched : {false, true}) {
    const SortedMesh one(front, std::uint64_t{64} << 20, 2, {stitched, 0.0});
    const SortedMesh two(both, std::uint64_t{64} << 20, 2, {stitched, 0.0});
    ASSERT_TRUE(one.buckets && two.buckets);
    ASSERT_GT(one.buckets->count(), 1U);
    expectSame(*one.buckets, *two.buckets);
    EXPECT_EQ(one.buckets->totals().two_sided, 0U);
    EXPECT_EQ(two.buckets->totals().two_sided, front.triangleCount());
    EXPECT_EQ(two.buckets->totals().triangles, front.triangleCount());
    EXPECT_EQ(two.buckets->winding().openEdges(), one.buckets->winding().openEdges());
    if (stitched) continue;
    const auto later = Buckets::open(two.scratch.path(), two.buckets->encodeTables());
    ASSERT_TRUE(later) << later.error().message;
    expectSame(*one.buckets, *later);
  }
}

TEST(Buckets, aLaterRunReadsTheSameTriangles) {
  const SortedMesh first(turnedSheet(400), std::uint64_t{64} << 20, 2, kUnstitched);
  ASSERT_TRUE(first.buckets) << first.buckets.error().message;
  const auto later = Buckets::open(first.scratch.path(), first.buckets->encodeTables());
  ASSERT_TRUE(later) << later.error().message;
  expectSame(*first.buckets, *later);
}

TEST(Buckets, borderTrianglesAreThoseThatReadFindsAtTheBorder) {
  for (const bool later : {false, true}) {
    const SortedMesh sorted(turnedSheet(400), std::uint64_t{64} << 20, 2, kUnstitched);
    ASSERT_TRUE(sorted.buckets);
    const auto opened = Buckets::open(sorted.scratch.path(), sorted.buckets->encodeTables());
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

TEST(Buckets, keepsColorsAndNormalsForAnyOrderOfTriangles) {
  for (const bool shuffled : {false, true}) {
    Mesh mesh = turnedSheet(300);
    for (const glm::vec3& p : mesh.positions) {
      mesh.normals.push_back(glm::normalize(glm::vec3(p.x - 150.0F, p.y - 150.0F, 90.0F)));
      mesh.colors.emplace_back(static_cast<int>(p.x) % 256, static_cast<int>(p.y) % 256, 7, 255);
    }
    if (shuffled) {
      std::vector<std::array<std::uint32_t, 3>> triangles(mesh.triangleCount());
      std::memcpy(triangles.data(), mesh.indices.data(), mesh.indices.size() * sizeof(std::uint32_t));
      std::shuffle(triangles.begin(), triangles.end(), std::minstd_rand(5));
      std::memcpy(mesh.indices.data(), triangles.data(), mesh.indices.size() * sizeof(std::uint32_t));
    }
    const SortedMesh sorted(mesh, std::uint64_t{64} << 20, 2, kUnstitched);
    ASSERT_TRUE(sorted.buckets) << sorted.buckets.error().message;
    using Key = std::array<std::uint64_t, 9>;
    const auto keyOf = [](const std::array<Corner, 3>& c) {
      Key key{};
      for (std::size_t k = 0; k < 3; ++k)
        key[3 * k] = c[k].code, key[3 * k + 1] = c[k].color, key[3 * k + 2] = c[k].normal;
      return key;
    };
    std::vector<Key> given, found;
    for (std::size_t t = 0; t < mesh.triangleCount(); ++t) {
      std::array<Corner, 3> corner{};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t v = mesh.indices[3 * t + k];
        const glm::u8vec4 c = mesh.colors[v];
        corner[k].code = mortonCode(sorted.lattice.point(glm::dvec3(mesh.positions[v])));
        corner[k].color = std::uint32_t{c.r} | std::uint32_t{c.g} << 8 | std::uint32_t{c.b} << 16 | 255U << 24;
        corner[k].normal = packNormal(mesh.normals[v]);
      }
      given.push_back(keyOf(corner));
    }
    for (std::size_t bucket = 0; bucket < sorted.buckets->count(); ++bucket) {
      const auto corners = sorted.buckets->read(bucket);
      ASSERT_TRUE(corners) << corners.error().message;
      for (std::size_t i = 0; i < corners->size(); i += 3)
        found.push_back(keyOf({(*corners)[i], (*corners)[i + 1], (*corners)[i + 2]}));
    }
    // A third of the triangles are flipped, so the second and third corner are sorted before comparing.
    const auto unwind = [](Key& key) {
      if (key[3] > key[6]) std::swap_ranges(key.begin() + 3, key.begin() + 6, key.begin() + 6);
    };
    for (auto* keys : {&given, &found}) {
      std::for_each(keys->begin(), keys->end(), unwind);
      std::sort(keys->begin(), keys->end());
    }
    EXPECT_TRUE(given == found) << (shuffled ? "shuffled" : "in order");
  }
}

TEST(Buckets, namesDamageOnDisk) {
  const SortedMesh sorted(turnedSheet(300), std::uint64_t{64} << 20, 2, kUnstitched);
  ASSERT_TRUE(sorted.buckets);
  const std::string path = sorted.scratch.path() + "/buckets";
  const auto whole = base::readFile(path);
  ASSERT_TRUE(whole);
  std::minstd_rand random(9);
  std::size_t named = 0;
  for (int i = 0; i < 60; ++i) {
    base::Bytes bytes = *whole;
    for (int k = 0; k < 64; ++k) bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    ASSERT_TRUE(base::writeFileAtomically(path, bytes));
    const auto opened = Buckets::open(sorted.scratch.path(), sorted.buckets->encodeTables());
    ASSERT_TRUE(opened);
    for (std::size_t bucket = 0; bucket < opened->count(); ++bucket) {
      const auto corners = opened->read(bucket);
      if (corners) continue;
      ++named;
      EXPECT_NE(corners.error().message.find(sorted.scratch.path()), std::string::npos) << corners.error().message;
    }
  }
  EXPECT_GT(named, 30U);
}

}  // namespace
