// Leaves of points without faces leave no hole and face alike; neighbours and planes are right; bad clouds are refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <random>

#include "lod/ingest/nearest_points.h"
#include "lod/qsplat/builder/build.h"
#include "lod/qsplat/builder/point_leaves.h"
#include "lod/qsplat/splat_file.h"
#include "mesh/generate/sample.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/ply_file.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::ingest;
using namespace lod::qsplat::builder;
using namespace mesh::generate;
using support::makeSample;
using support::Mesh;

TEST(NearestPoints, agreeWithExhaustiveSearch) {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  std::vector<glm::vec3> points(700);
  for (glm::vec3& p : points) p = {unit(random), unit(random), std::floor(4.0F * unit(random)) / 4.0F};
  for (std::size_t i = 0; i < 50; ++i) points[i] = points[50];
  const NearestPoints near(points);
  std::vector<NearestPoints::Neighbour> found;
  for (std::size_t i = 0; i < points.size(); i += 7)
    for (const std::size_t count : {1U, 5U, 17U})
      for (const float reach : {1e30F, 0.01F, 0.0F}) {
        std::vector<NearestPoints::Neighbour> all;
        for (std::uint32_t j = 0; j < points.size(); ++j) {
          const glm::vec3 d = points[j] - points[i];
          if (glm::dot(d, d) <= reach) all.push_back({glm::dot(d, d), j});
        }
        std::sort(all.begin(), all.end());
        all.resize(std::min(all.size(), count));
        near.find(points[i], count, reach, found);
        ASSERT_EQ(found.size(), all.size());
        for (std::size_t k = 0; k < all.size(); ++k) ASSERT_EQ(found[k].index, all[k].index);
      }
}

TEST(PlaneNormal, isThatOfThePlane) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const glm::dvec3 n = glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
    const glm::dvec3 u = glm::normalize(glm::cross(n, glm::dvec3(0.2, 0.5, 0.7))), v = glm::cross(n, u);
    std::vector<glm::dvec3> points;
    for (int k = 0; k < 12; ++k)
      points.push_back(glm::dvec3(1e3) + 1e-3 * (normal(random) * u + 0.3 * normal(random) * v));
    EXPECT_NEAR(std::abs(glm::dot(planeNormal(points), n)), 1.0, 1e-6);
  }
  const std::vector<glm::dvec3> line{glm::dvec3(0), glm::dvec3(1, 0, 0), glm::dvec3(2, 0, 0)};
  EXPECT_EQ(planeNormal(line), glm::dvec3(0, 0, 1));
  const std::vector<glm::dvec3> place(3, glm::dvec3(7));
  EXPECT_EQ(planeNormal(place), glm::dvec3(0, 0, 1));
}

TEST(CellReach, isHalfADiagonalOnAGrid) {
  std::vector<glm::dvec3> others;
  for (int x = -2; x <= 2; ++x)
    for (int y = -2; y <= 2; ++y)
      if (x != 0 || y != 0) others.emplace_back(x, y, 0.0);
  const glm::dvec3 up(0, 0, 1);
  EXPECT_NEAR(cellReach(glm::dvec3(0), up, others, {10.0, 0.5, 0.5}), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(cellReach(glm::dvec3(0), up, {}, {3.0, 2.5, 2.0}), 2.0, 1e-12);
  // At a rim the corners between neighbours still count.
  std::erase_if(others, [](const glm::dvec3& p) { return p.x < 0.0; });
  EXPECT_NEAR(cellReach(glm::dvec3(0), up, others, {10.0, 5.0, 0.6}), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(cellReach(glm::dvec3(0), up, others, {10.0, 5.0, 2.0}), 2.0, 1e-12);
  EXPECT_NEAR(cellReach(glm::dvec3(0), up, others, {10.0, 0.6, 0.6}), 0.6, 1e-12);
}

class PointCloud : public testing::Test {
 protected:
  std::string path() const { return directory_ / "out.lgq"; }

  base::Result<BuildSummary> build(const std::vector<glm::dvec3>& points, const BuildOptions& options = {}) {
    support::PlyMesh ply;
    ply.positions = points;
    writePly(directory_ / "points.ply", ply);
    return buildFromFiles({directory_ / "points.ply"}, options, path());
  }
  BuildSummary mustBuild(const std::vector<glm::dvec3>& points, const BuildOptions& options = {}) {
    auto summary = build(points, options);
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    const auto file = lod::qsplat::SplatFile::open(path());
    EXPECT_TRUE(file);
    EXPECT_EQ(file->verify(), std::vector<std::string>());
    EXPECT_FALSE(std::filesystem::exists(path() + ".work"));
    return std::move(*summary);
  }
  // The leaves that PointLeaves makes.
  std::vector<Splat> leaves(const std::vector<glm::dvec3>& points, std::size_t* tiles = nullptr) {
    support::PlyMesh ply;
    ply.positions = points;
    ply.doubles = true;
    writePly(directory_ / "points.ply", ply);
    const std::vector<std::string> paths{directory_ / "points.ply"};
    const Progress none;
    auto directory = WorkDirectory::open(directory_ / "work", {});
    const auto input = sourceFromFiles(paths, none, 1, true);
    const auto source = importSource(*directory, *input, 2);
    EXPECT_TRUE(source) << source.error().message;
    const SourceLattice lattice = makeLattice(source->info, source->origin, kMaxLatticeBits);
    const auto spool = openSource(*directory, *source);
    const auto sorted = PointTiles::sort(*spool, source->info, lattice, directory->path(), {});
    EXPECT_TRUE(sorted);
    PointLeaves fitted(*sorted, lattice, false);
    EXPECT_TRUE(fitted.fitAll(directory_ / "fitted", 2, {}));
    std::vector<Splat> out;
    for (std::size_t t = 0; t < fitted.tiles(); ++t) {
      const auto some = fitted.leaves(t);
      EXPECT_TRUE(some);
      out.insert(out.end(), some->splats.begin(), some->splats.end());
    }
    if (tiles != nullptr) *tiles = fitted.tiles();
    directory->remove();
    return out;
  }
  static std::vector<glm::dvec3> pointsOf(const Mesh& mesh) { return {mesh.positions.begin(), mesh.positions.end()}; }

  support::TemporaryDirectory directory_;
};

TEST_F(PointCloud, aClosedShapeFacesOutAndHasNoHole) {
  const Mesh mesh = support::bumpySphere(40, 60);
  const std::vector<Splat> all = leaves(pointsOf(mesh));
  ASSERT_EQ(all.size(), mesh.positions.size());
  // At the poles neighbours lie nearly on a line, so that planes may stand upright.
  const auto out = std::count_if(all.begin(), all.end(), [](const Splat& leaf) {
    return glm::dot(glm::normalize(leaf.normal), glm::normalize(leaf.sphere.center)) > 0.5F;
  });
  EXPECT_GT(static_cast<double>(out), 0.93 * static_cast<double>(all.size()));
  std::size_t uncovered = 0;
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    const glm::vec3 middle =
        (mesh.positions[mesh.indices[t]] + mesh.positions[mesh.indices[t + 1]] + mesh.positions[mesh.indices[t + 2]]) /
        3.0F;
    uncovered += std::none_of(all.begin(), all.end(),
                              [&](const Splat& leaf) {
                                return glm::distance(leaf.sphere.center, middle) <= 1.05F * leaf.sphere.radius;
                              })
                     ? 1
                     : 0;
  }
  EXPECT_EQ(uncovered, 0U);
}

// The share of places on a plane from `low` to `high` that no leaf covers.
double shareUncovered(const std::vector<Splat>& leaves, const glm::vec2& low, const glm::vec2& high) {
  std::mt19937 random(8);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  constexpr int kPlaces = 2000;
  int uncovered = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const glm::vec3 place(glm::mix(low, high, glm::vec2(unit(random), unit(random))), 0.0F);
    uncovered +=
        std::none_of(leaves.begin(), leaves.end(),
                     [&](const Splat& leaf) { return glm::distance(leaf.sphere.center, place) <= leaf.sphere.radius; })
            ? 1
            : 0;
  }
  return static_cast<double>(uncovered) / kPlaces;
}

// Points around the origin, so that the scene's origin is there; most of them on the left, and on the right 250 times
// fewer an area.
std::vector<glm::dvec3> denseAndSparse() {
  std::mt19937 random(9);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<glm::dvec3> points{{-20, -10, 0}, {20, -10, 0}, {-20, 10, 0}, {20, 10, 0}};
  for (int i = 0; i < 20'000; ++i) points.emplace_back(-20.0 + 20.0 * unit(random), -10.0 + 20.0 * unit(random), 0.0);
  for (int i = 0; i < 80; ++i) points.emplace_back(20.0 * unit(random), -10.0 + 20.0 * unit(random), 0.0);
  return points;
}

// Before, nothing farther than eight times what is usual in a tile was a neighbour, and 64 in 100 places were bare on
// the right. Those left are at the rim, and at the edge of the dense part.
TEST_F(PointCloud, sparsePartsOfASurfaceAreClosed) {
  const std::vector<Splat> all = leaves(denseAndSparse());
  EXPECT_LT(shareUncovered(all, {-19.0F, -9.0F}, {-1.0F, 9.0F}), 0.002);
  EXPECT_LT(shareUncovered(all, {1.0F, -8.0F}, {18.0F, 8.0F}), 0.15);
}

TEST_F(PointCloud, densityMayFallByAHundredFromNearToFar) {
  std::mt19937 random(10);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::vector<glm::dvec3> points;
  for (int i = 0; i < 30'000; ++i) {
    const double r = std::exp(unit(random) * std::log(30.0)), turn = 6.283185307 * unit(random);
    points.emplace_back(r * std::cos(turn), r * std::sin(turn), 0.0);
  }
  const std::vector<Splat> all = leaves(points);
  for (const float r : {1.5F, 5.0F, 18.0F})
    EXPECT_LT(shareUncovered(all, {0.8F * r, 0.2F * r}, {1.1F * r, 0.8F * r}), 0.002) << r;
}

// As large as their gap, they were before: up to eight usual distances.
TEST_F(PointCloud, straysAreAsLargeAsIsUsual) {
  std::vector<glm::dvec3> points = denseAndSparse();
  std::erase_if(points, [](const glm::dvec3& p) { return p.x > 0.0; });
  for (int i = 0; i < 30; ++i) points.emplace_back(-19.0 + 0.6 * i, 0.3 * i - 4.5, 0.7 + 0.1 * (i % 5));
  const std::vector<Splat> all = leaves(points);
  ASSERT_EQ(all.size(), points.size());
  const float low = std::min_element(all.begin(), all.end(), [](const Splat& a, const Splat& b) {
                      return a.sphere.center.z < b.sphere.center.z;
                    })->sphere.center.z;
  float usual = 0.0F, largest = 0.0F;
  for (const Splat& leaf : all) {
    float& most = leaf.sphere.center.z - low > 0.35F ? largest : usual;
    most = std::max(most, leaf.sphere.radius);
  }
  EXPECT_GT(largest, 0.0F);
  EXPECT_LE(largest, usual);
}

TEST_F(PointCloud, signsAgreeAcrossTiles) {
  SampleOptions sample;
  sample.triangles = 600000;
  const Mesh mesh = makeSample(sample);
  std::size_t tiles = 0;
  const std::vector<Splat> all = leaves(pointsOf(mesh), &tiles);
  EXPECT_GT(tiles, 1U);
  const std::vector<glm::vec3> normals = support::vertexNormals(mesh);
  std::map<std::tuple<int, int, int>, glm::vec3> by_place;
  const auto cell = [](const glm::vec3& p) {
    const glm::ivec3 q(glm::round(p * 1e4F));
    return std::tuple(q.x, q.y, q.z);
  };
  for (std::size_t v = 0; v < normals.size(); ++v) by_place[cell(mesh.positions[v])] = normals[v];
  std::size_t agree = 0, met = 0;
  for (const Splat& leaf : all) {
    const auto at = by_place.find(cell(leaf.sphere.center));
    if (at == by_place.end()) continue;
    ++met;
    agree += glm::dot(at->second, leaf.normal) > 0.0F ? 1 : 0;
  }
  EXPECT_GT(met, all.size() / 2);
  EXPECT_GT(static_cast<double>(agree), 0.99 * static_cast<double>(met));
}

TEST_F(PointCloud, aFlatScanFacesUp) {
  std::vector<glm::dvec3> points;
  for (int x = 0; x < 60; ++x)
    for (int y = 0; y < 60; ++y) points.emplace_back(500000.0 + x, 6000000.0 + y, 100.0 + 0.3 * std::sin(0.2 * x));
  const BuildSummary summary = mustBuild(points);
  EXPECT_EQ(summary.header.leaves, points.size());
  EXPECT_EQ(summary.triangles, 0U);
  EXPECT_GT(summary.facing.z, 0.0);
  EXPECT_GT(std::abs(summary.origin.x), 400000.0);
}

TEST_F(PointCloud, threadsDoNotChangeTheBytes) {
  SampleOptions sample;
  sample.triangles = 600000;
  const std::vector<glm::dvec3> points = pointsOf(makeSample(sample));
  base::Bytes first;
  for (const unsigned threads : {1U, 4U}) {
    BuildOptions options;
    options.limits.threads = threads;
    mustBuild(points, options);
    if (first.empty()) first = *base::readFile(path());
    EXPECT_TRUE(*base::readFile(path()) == first);
  }
}

TEST_F(PointCloud, fewPointsMakeATree) {
  const glm::dvec3 p(1.0, 2.0, 3.0);
  EXPECT_EQ(mustBuild({p}).header.leaves, 1U);
  EXPECT_EQ(mustBuild({p, p, p}).header.leaves, 1U);
  EXPECT_EQ(mustBuild({p, 2.0 * p}).header.leaves, 2U);
  EXPECT_EQ(mustBuild({p, 2.0 * p, 3.0 * p}).header.leaves, 3U);
  std::vector<glm::dvec3> line;
  for (int i = 0; i < 500; ++i) line.push_back(p * static_cast<double>(i));
  EXPECT_EQ(mustBuild(line).header.leaves, 500U);
  EXPECT_EQ(mustBuild({p, glm::dvec3(NAN)}).header.leaves, 1U) << "places that are no numbers are left out";
  const auto bad = build({p, glm::dvec3(2e18)});
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().message.find("vertex 1"), std::string::npos) << bad.error().message;
}

}  // namespace
