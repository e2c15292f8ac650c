// Generated meshes have the size asked for and the same bytes every time, and are closed where they say so.
#include "mesh/generate/sample.h"

#include <algorithm>
#include <cmath>

#include "base/crc32c.h"
#include "base/file.h"
#include "lod/qsplat/builder/build.h"
#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;
using mesh::generate::SampleOptions;
using mesh::generate::SampleShape;
using mesh::generate::writeSamplePly;
using support::makeSample;

SampleOptions options(SampleShape shape, std::uint64_t triangles, std::uint64_t seed = 1) {
  SampleOptions o;
  o.shape = shape;
  o.triangles = triangles;
  o.seed = seed;
  return o;
}

std::string written(const SampleOptions& o) {
  const std::string path = write("sample.ply", "");
  const auto result = writeSamplePly(o, path);
  EXPECT_TRUE(result) << (result ? "" : result.error().message);
  return path;
}

TEST(Sample, hasTheTrianglesAskedForWithinTwoPercent) {
  for (const auto shape : {SampleShape::kStatue, SampleShape::kRelief})
    for (const std::uint64_t wanted : {10'000U, 10'078U, 12'345U, 33'333U, 100'000U}) {
      const double triangles = static_cast<double>(makeSample(options(shape, wanted)).triangleCount());
      EXPECT_NEAR(triangles / static_cast<double>(wanted), 1.0, 0.02) << wanted;
    }
}

TEST(Sample, statueIsClosedManifoldAndFacesOutward) {
  const Mesh mesh = makeSample(options(SampleShape::kStatue, 60'000));
  EXPECT_TRUE(isClosed(mesh));
  EXPECT_EQ(mesh.positions.size(), mesh.triangleCount() / 2 + 2);  // Euler: genus 0
  EXPECT_GT(signedVolume(mesh), 0.1);
}

TEST(Sample, buildersFindNothingToRepair) {
  for (const auto shape : {SampleShape::kStatue, SampleShape::kRelief}) {
    const std::string path = written(options(shape, 200'000, 7));
    const auto built = lod::qsplat::builder::buildFromFiles({path}, {}, path + ".lgq");
    ASSERT_TRUE(built) << built.error().message;
    // Vertices may still meet on the builder's lattice.
    for (const char* repair :
         {"degenerate_triangles", "flipped_triangles", "non_orientable_parts", "unreferenced_vertices"})
      EXPECT_FALSE(built->repairs.counts.contains(repair)) << repair;
    const auto read = support::readMesh(path);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(isClosed(read->mesh), shape == SampleShape::kStatue);
    std::remove(path.c_str()), std::remove((path + ".lgq").c_str());
  }
}

TEST(Sample, pointsAreTheVerticesOfTheMesh) {
  SampleOptions o = options(SampleShape::kStatue, 20'000, 3);
  const std::string mesh = written(o);
  const auto whole = base::readFile(mesh);
  const std::size_t vertices = makeSample(o).positions.size();
  o.faces = false;
  const auto points = base::readFile(written(o));
  ASSERT_TRUE(whole && points);
  const auto bodyOf = [](const base::Bytes& file) {
    const std::string end = "end_header\n";
    return std::search(file.begin(), file.end(), end.begin(), end.end()) + static_cast<std::ptrdiff_t>(end.size());
  };
  const auto body = bodyOf(*points);
  EXPECT_EQ(std::string(points->begin(), body).find("face"), std::string::npos);
  EXPECT_EQ(points->end() - body, 15 * static_cast<std::ptrdiff_t>(vertices));
  EXPECT_TRUE(std::equal(body, points->end(), bodyOf(*whole)));
  std::remove(mesh.c_str());
}

TEST(Sample, isDeterminedByItsSeedAlone) {
  for (const auto shape : {SampleShape::kStatue, SampleShape::kRelief}) {
    const Mesh one = makeSample(options(shape, 10'000, 1));
    EXPECT_EQ(one.positions, makeSample(options(shape, 10'000, 1)).positions);
    EXPECT_NE(one.positions, makeSample(options(shape, 10'000, 2)).positions);
  }
}

// One small sample of each shape must have these bytes on every machine and with every compiler.
TEST(Sample, bytesAreTheSameOnEveryMachine) {
  const std::array<std::pair<SampleShape, std::uint32_t>, 2> golden{
      {{SampleShape::kStatue, 0x5EA3C9B6U}, {SampleShape::kRelief, 0xF56DE04BU}}};
  for (const auto& [shape, crc] : golden) {
    const std::string path = written(options(shape, 10'000, 42));
    const auto bytes = base::readFile(path);
    ASSERT_TRUE(bytes);
    EXPECT_EQ(base::crc32c(*bytes), crc);
    std::remove(path.c_str());
  }
}

TEST(Sample, detailGoesOnWhereTrianglesGetFiner) {
  // Roughness of the relief: mean change of direction between neighbours. Were the finer mesh smooth, it would fall
  // with the edge length, to a quarter here.
  const auto roughness = [](std::uint64_t triangles) {
    const Mesh mesh = makeSample(options(SampleShape::kRelief, triangles));
    double sum = 0.0;
    for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
      sum += 1.0 - static_cast<double>(glm::dot(mesh.normals[mesh.indices[i]], mesh.normals[mesh.indices[i + 1]]));
    return std::sqrt(sum / static_cast<double>(mesh.triangleCount()));
  };
  EXPECT_GT(roughness(640'000), 0.5 * roughness(40'000));
}

TEST(Sample, colorsVary) {
  const Mesh mesh = makeSample(options(SampleShape::kStatue, 20'000));
  std::set<std::array<int, 3>> seen;
  for (const auto& c : mesh.colors) seen.insert({c.r / 16, c.g / 16, c.b / 16});
  EXPECT_GT(seen.size(), 60U);
}

TEST(Sample, surveyOriginIsWrittenAsDouble) {
  SampleOptions o = options(SampleShape::kStatue, 10'000);
  o.origin = {431234.0, 5412345.0, 210.0};
  const std::string path = written(o);
  const auto moved = support::readMesh(path);
  ASSERT_TRUE(moved) << moved.error().message;
  const Mesh mesh = makeSample(options(SampleShape::kStatue, 10'000));
  ASSERT_EQ(moved->mesh.positions.size(), mesh.positions.size());
  for (std::size_t v = 0; v < mesh.positions.size(); ++v)
    ASSERT_LT(glm::distance(moved->mesh.origin + glm::dvec3(moved->mesh.positions[v]),
                            o.origin + glm::dvec3(mesh.positions[v])),
              1e-5);
  std::remove(path.c_str());
}

TEST(Sample, wrongSizesAndStopsLeaveNoFile) {
  const std::string path = mesh_files::directory() / "never.ply";
  EXPECT_FALSE(writeSamplePly(options(SampleShape::kStatue, 9'999), path));
  EXPECT_FALSE(writeSamplePly(options(SampleShape::kStatue, 1'000'000'001), path));
  const auto stopped = writeSamplePly(options(SampleShape::kStatue, 10'000), path, [](double) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
  EXPECT_FALSE(base::readFile(path));
}

}  // namespace
