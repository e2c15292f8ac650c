// Whole builds of point clouds: what is in the file, that it does not depend on threads, and that leaves fit together.
#include "lod/pmr/builder/build.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numbers>
#include <random>
#include <set>

#include "base/file.h"
#include "lod/disk_bytes.h"
#include "lod/pmr/check_file.h"
#include "lod/pmr/chunks.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/ply_file.h"
#include "tests/support/shapes.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::pmr;
using namespace lod::pmr::builder;

class PmrBuild : public testing::Test {
 protected:
  std::string path() const { return directory_ / "pmr.lgm"; }

  base::Result<BuildSummary> build(const std::vector<glm::dvec3>& points, const BuildOptions& options = {}) {
    support::PlyMesh ply;
    ply.positions = points;
    ply.doubles = true;
    writePly(directory_ / "points.ply", ply);
    return buildFromFiles({directory_ / "points.ply"}, options, path());
  }
  // Builds, and checks the file.
  BuildSummary mustBuild(const std::vector<glm::dvec3>& points, const BuildOptions& options = {}) {
    const auto summary = build(points, options);
    EXPECT_TRUE(summary) << summary.error().message;
    if (!summary) return {};
    for (const std::string& fault : faults()) ADD_FAILURE() << fault;
    EXPECT_EQ(summary->points[0], summary->header.points);
    return *summary;
  }
  std::vector<std::string> faults() const {
    auto file = base::PositionedFile::open(path());
    return file ? checkFile(lod::DiskBytes(std::move(*file))) : std::vector{file.error().message};
  }

  // A leaf at a level, decoded.
  struct Decoded {
    std::vector<CodedPoint> points;
    std::vector<std::uint16_t> corners;
  };
  struct Whole {
    base::Bytes bytes;
    Header header;
    std::vector<Leaf> leaves;

    Decoded at(const Leaf& leaf, std::uint32_t level) const {
      Decoded out;
      for (std::uint32_t c = kLevels; c-- > level;) {
        const LevelRow& row = leaf.levels[c];
        EXPECT_TRUE(decodePoints(base::ByteView(bytes).subspan(row.point_offset, row.point_bytes), row.points,
                                 row.foreign, header.colors, out.points));
      }
      std::vector<glm::ivec3> places;
      for (const CodedPoint& point : out.points) places.push_back(point.place);
      const LevelRow& row = leaf.levels[level];
      auto corners = decodeTriangles(base::ByteView(bytes).subspan(row.triangle_offset, row.triangle_bytes),
                                     row.triangles, places);
      EXPECT_TRUE(corners);
      if (corners) out.corners = std::move(*corners);
      return out;
    }
  };
  Whole whole() const {
    Whole out;
    out.bytes = *base::readFile(path());
    out.header = *readHeader(out.bytes);
    out.leaves = *readTable(out.header, base::ByteView(out.bytes).subspan(kHeaderBytes, out.header.table_bytes));
    return out;
  }

  support::TemporaryDirectory directory_;
};

std::vector<glm::dvec3> placesOf(const std::vector<support::ShapeSample>& samples) {
  std::vector<glm::dvec3> places;
  for (const auto& sample : samples) places.push_back(sample.place);
  return places;
}

TEST_F(PmrBuild, keepsEachPointNearItsPlace) {
  const auto points = placesOf(support::torusSamples(10.0, 4.0, 30000, 1));
  const BuildSummary summary = mustBuild(points);
  EXPECT_EQ(summary.points[0] + summary.duplicates, points.size());
  EXPECT_LT(summary.duplicates, 10U);
  for (std::uint32_t level = 1; level < kLevels; ++level) {
    EXPECT_LE(summary.points[level], summary.points[level - 1]);
    EXPECT_GT(summary.points[level], 0U);
  }
  const Whole file = whole();
  std::set<std::tuple<int, int, int>> places;
  for (const Leaf& leaf : file.leaves) {
    const Decoded decoded = file.at(leaf, 0);
    for (const CodedPoint& point : decoded.points) places.insert({point.place.x, point.place.y, point.place.z});
  }
  EXPECT_EQ(places.size(), file.header.points);
  // The lattice is fine compared with the spacing, about √(area / points).
  const double spacing = std::sqrt(4.0 * std::numbers::pi * std::numbers::pi * 10.0 * 4.0 / 30000.0);
  EXPECT_LT(file.header.lattice.step, spacing / 32.0);
  for (const glm::dvec3& p : points) {
    const glm::ivec3 q(glm::round((p - summary.origin - file.header.lattice.origin) / file.header.lattice.step));
    EXPECT_TRUE(places.contains({q.x, q.y, q.z}));
  }
}

TEST_F(PmrBuild, threadsAndMemoryDoNotChangeTheBytes) {
  const auto points = placesOf(support::torusSamples(10.0, 4.0, 300000, 2));
  base::Bytes first;
  for (const unsigned threads : {1U, 4U}) {
    BuildOptions options;
    options.limits.threads = threads;
    options.limits.memory_bytes = threads == 1 ? std::uint64_t{1} << 30 : 0;
    mustBuild(points, options);
    const auto bytes = *base::readFile(path());
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

TEST_F(PmrBuild, neighboursShareTheTrianglesBetweenThem) {
  mustBuild(placesOf(support::torusSamples(10.0, 4.0, 300000, 3)));
  const Whole file = whole();
  ASSERT_GT(file.leaves.size(), 20U);
  using Place = std::tuple<int, int, int>;
  for (const std::uint32_t level : {0U, 1U, 2U, 5U}) {
    // Each triangle by its places, with the leaves that have it; and the leaf of each point.
    std::map<std::array<Place, 3>, std::set<std::uint32_t>> leaves_of;
    std::map<Place, std::uint32_t> leaf_of;
    for (std::uint32_t l = 0; l < file.leaves.size(); ++l) {
      const Decoded decoded = file.at(file.leaves[l], level);
      const auto placeOf = [&](std::uint16_t v) {
        const glm::ivec3& q = decoded.points[v].place;
        return Place(q.x, q.y, q.z);
      };
      std::uint32_t before = 0;
      for (std::uint32_t c = kLevels; c-- > level;) {
        const LevelRow& row = file.leaves[l].levels[c];
        for (std::uint32_t i = 0; i < row.points; ++i) leaf_of[placeOf(static_cast<std::uint16_t>(before + i))] = l;
        before += row.points + row.foreign;
      }
      for (std::size_t t = 0; t < decoded.corners.size(); t += 3) {
        std::array<Place, 3> key{placeOf(decoded.corners[t]), placeOf(decoded.corners[t + 1]),
                                 placeOf(decoded.corners[t + 2])};
        std::sort(key.begin(), key.end());
        leaves_of[key].insert(l);
      }
    }
    std::size_t between = 0, shared = 0;
    for (const auto& [key, leaves] : leaves_of) {
      std::set<std::uint32_t> of_points;
      for (const Place& place : key) of_points.insert(leaf_of.at(place));
      if (of_points.size() < 2) continue;
      ++between;
      shared += leaves == of_points ? 1 : 0;
    }
    // "Very likely present within the umbrellas of the other two vertices" (section 2, "Records").
    EXPECT_GT(between, 100U);
    EXPECT_GT(static_cast<double>(shared), 0.97 * static_cast<double>(between)) << level;
  }
}

TEST_F(PmrBuild, fewPointsMakeAFile) {
  const glm::dvec3 p(1.0, 2.0, 3.0);
  EXPECT_EQ(mustBuild({p}).header.points, 1U);
  EXPECT_EQ(mustBuild({p, p, p}).duplicates, 2U);
  EXPECT_EQ(mustBuild({p, 2.0 * p}).header.points, 2U);
  EXPECT_EQ(mustBuild({p, 2.0 * p, 3.0 * p}).header.points, 3U);
  std::vector<glm::dvec3> line;
  for (int i = 0; i < 500; ++i) line.push_back(p * static_cast<double>(i));
  EXPECT_EQ(mustBuild(line).header.points, 500U);
  EXPECT_EQ(mustBuild({p, glm::dvec3(NAN)}).header.points, 1U) << "places that are no numbers are left out";
  const auto bad = build({p, glm::dvec3(2e18)});
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().message.find("vertex 1"), std::string::npos) << bad.error().message;
}

TEST_F(PmrBuild, hardInputsAreBuilt) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  std::normal_distribution<double> normal;
  const auto sphere = placesOf(support::sphereSamples(1.0, 20000, 5));

  std::vector<glm::dvec3> noisy = sphere;  // by a third of the spacing
  for (glm::dvec3& p : noisy) p += 0.008 * glm::dvec3(normal(random), normal(random), normal(random));
  EXPECT_EQ(mustBuild(noisy).points[0], noisy.size());

  std::vector<glm::dvec3> lines;  // scan lines, ten times closer along than across
  for (int y = 0; y < 60; ++y)
    for (int x = 0; x < 600; ++x) lines.emplace_back(0.1 * x, y, 0.01 * std::sin(0.3 * y));
  mustBuild(lines);

  std::vector<glm::dvec3> uneven;  // a hundred times denser at one end
  while (uneven.size() < 30000) {
    const double x = unit(random);
    if (unit(random) < 0.01 + 0.99 * x * x) uneven.emplace_back(x, unit(random), 0.05 * std::sin(9.0 * x));
  }
  mustBuild(uneven);

  std::vector<glm::dvec3> missing;  // a third of the sphere and many holes
  for (const glm::dvec3& p : sphere)
    if (p.z < 0.4 && std::sin(20.0 * p.x) < 0.7) missing.push_back(p);
  mustBuild(missing);

  std::vector<glm::dvec3> outliers = sphere;
  for (int i = 0; i < 200; ++i) outliers.emplace_back(20.0 * unit(random), 20.0 * unit(random), 20.0 * unit(random));
  EXPECT_LE(mustBuild(outliers).duplicates, 2U);

  std::vector<glm::dvec3> block;  // a solid: no surface at all, all cospherical by eights
  for (int x = 0; x < 25; ++x)
    for (int y = 0; y < 25; ++y)
      for (int z = 0; z < 25; ++z) block.emplace_back(x, y, z);
  EXPECT_EQ(mustBuild(block).points[0], block.size());

  std::vector<glm::dvec3> survey;  // coordinates of a country's grid
  for (const glm::dvec3& p : sphere) survey.push_back(glm::dvec3(5e5, 6e6, 100.0) + 10.0 * p);
  const BuildSummary of_survey = mustBuild(survey);
  EXPECT_GT(std::abs(of_survey.origin.y), 5e6);
}

TEST_F(PmrBuild, aPlaneLosesItsMiddleButNotItsRim) {
  std::vector<glm::dvec3> plane;
  for (int x = 0; x < 200; ++x)
    for (int y = 0; y < 200; ++y) plane.emplace_back(x, y, 5.0);
  const BuildSummary summary = mustBuild(plane);
  EXPECT_EQ(summary.points[0], plane.size());
  EXPECT_LT(summary.points[kCoarsest], 3000U);
  EXPECT_GE(summary.points[kCoarsest], 800U);
  // Two triangles for each square.
  EXPECT_LT(static_cast<double>(summary.triangles[0]), 2.2 * static_cast<double>(plane.size()));
  EXPECT_GT(static_cast<double>(summary.triangles[0]), 1.9 * static_cast<double>(plane.size()));
}

TEST_F(PmrBuild, aPlaneOfOneLeafKeepsSomeOfItsMiddle) {
  std::vector<glm::dvec3> plane;
  for (int x = 0; x < 100; ++x)
    for (int y = 0; y < 100; ++y) plane.emplace_back(x, y, 5.0);
  const BuildSummary summary = mustBuild(plane);
  EXPECT_EQ(summary.points[0], plane.size());
  EXPECT_GT(summary.points[1], 396U + 100U);  // the rim and more
  EXPECT_GT(summary.triangles[kCoarsest], 396U);
}

TEST_F(PmrBuild, strayPointsChangeNothingForTheOthers) {
  // Cells of stray points are wide, and one that lies beside the cloud must not take in all of it.
  auto points = placesOf(support::sphereSamples(1.0, 200000, 7));
  const BuildSummary alone = mustBuild(points);
  points.emplace_back(5.0, 0.0, 0.0);
  points.emplace_back(-3.0, 0.0, 0.0);
  BuildOptions options;
  options.limits.memory_bytes = std::uint64_t{512} << 20;
  const BuildSummary summary = mustBuild(points, options);
  EXPECT_EQ(summary.points[0] + summary.duplicates, points.size());
  EXPECT_LT(summary.duplicates, points.size() / 1000);
  EXPECT_LT(static_cast<double>(summary.points[5]), 1.3 * static_cast<double>(alone.points[5]));
}

TEST_F(PmrBuild, aStrayPointInALeafDoesNotThinIt) {
  // One leaf, nearly all of it empty. The narrow one's edge bounds heights a little, so that it keeps more.
  auto points = placesOf(support::sphereSamples(1.0, 9000, 11));
  const BuildSummary alone = mustBuild(points);
  points.emplace_back(1000.0, 0.0, 0.0);
  const BuildSummary summary = mustBuild(points);
  for (const std::uint32_t level : {1U, 3U, 6U, kCoarsest})
    EXPECT_GT(static_cast<double>(summary.points[level]), 0.3 * static_cast<double>(alone.points[level])) << level;
}

TEST_F(PmrBuild, unevenCloudsKeepTheirPoints) {
  // A far point, and a dense part beside a wide one: the lattice must suit the dense part.
  auto points = placesOf(support::sphereSamples(1.0, 5000, 8));
  points.emplace_back(1000.0, 0.0, 0.0);
  EXPECT_LT(mustBuild(points).duplicates, 10U);
  points.pop_back();
  for (const auto& sample : support::sphereSamples(0.001, 5000, 9))
    points.push_back(glm::dvec3(1.5, 0.0, 0.0) + sample.place);
  EXPECT_LT(mustBuild(points).duplicates, 10U);
  // Points that have no place, as some scanners write them, are one.
  points.resize(5000);
  points.insert(points.end(), 1000, glm::dvec3(0.0));
  const BuildSummary summary = mustBuild(points);
  EXPECT_GE(summary.duplicates, 999U);
  EXPECT_LT(summary.duplicates, 1009U);
}

TEST_F(PmrBuild, sidesAreThoseOfTheSource) {
  // Normals at corners, as OBJ has them, count like those of vertices; where some are missing there are no sides.
  const auto samples = support::sphereSamples(1.0, 4000, 10);
  const auto facing = [&](const std::string& text) {
    EXPECT_TRUE(base::writeFileAtomically(
        directory_ / "sides.obj", base::ByteView(reinterpret_cast<const std::uint8_t*>(text.data()), text.size())));
    const auto summary = buildFromFiles({directory_ / "sides.obj"}, {}, path());
    EXPECT_TRUE(summary) << summary.error().message;
    const Whole file = whole();
    std::size_t out = 0;
    for (const Leaf& leaf : file.leaves)
      for (const CodedPoint& point : file.at(leaf, 0).points)
        out += glm::dot(decodeNormal(point.normal), file.header.lattice.position(point.place)) > 0.0F ? 1 : 0;
    return std::pair(file.header.oriented, static_cast<double>(out) / static_cast<double>(file.header.points));
  };
  std::string text;
  for (const auto& sample : samples) {
    const auto &p = sample.place, &n = sample.normal;
    text += "v " + std::to_string(p.x) + " " + std::to_string(p.y) + " " + std::to_string(p.z) + "\n";
    text += "vn " + std::to_string(n.x) + " " + std::to_string(n.y) + " " + std::to_string(n.z) + "\n";
  }
  std::string with, without;
  for (std::size_t i = 0; i + 2 < samples.size(); ++i) {
    with += "f";
    without += "f";
    for (std::size_t k = i + 1; k < i + 4; ++k) {
      with += " " + std::to_string(k) + "//" + std::to_string(k);
      without += " " + std::to_string(k);
    }
    with += "\n", without += "\n";
  }
  const auto [oriented, share] = facing(text + with);
  EXPECT_TRUE(oriented);
  EXPECT_GT(share, 0.99);
  EXPECT_FALSE(facing(text + without).first);
}

TEST_F(PmrBuild, meshesAreTheirVertices) {
  mesh::generate::SampleOptions options;
  options.triangles = 20000;
  const auto sample = support::makeSample(options);
  support::PlyMesh ply;
  ply.positions.assign(sample.positions.begin(), sample.positions.end());
  ply.positions.emplace_back(1e3, 1e3, 1e3);  // no triangle uses it
  ply.indices = sample.indices;
  writePly(directory_ / "mesh.ply", ply);
  const auto summary = buildFromFiles({directory_ / "mesh.ply"}, {}, path());
  ASSERT_TRUE(summary) << summary.error().message;
  EXPECT_TRUE(faults().empty());
  EXPECT_EQ(summary->points[0] + summary->duplicates, sample.positions.size());
}

TEST_F(PmrBuild, tooLittleMemoryIsSaidWithWhatWouldDo) {
  BuildOptions options;
  options.limits.memory_bytes = std::uint64_t{256} << 20;
  auto points = placesOf(support::torusSamples(10.0, 4.0, 400000, 6));
  const auto summary = build(points, options);
  ASSERT_FALSE(summary);
  EXPECT_NE(summary.error().message.find("--memory"), std::string::npos) << summary.error().message;
}

}  // namespace
