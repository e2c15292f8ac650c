#include "server/cli/verify_cuts.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "lod/patch/codec.h"
#include "tests/lod/patch/builder/built_cut.h"
#include "tests/support/built_hierarchy.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace server::cli {
namespace {

using lod::patch::PatchFile;
using lod::patch::PatchGeometry;

class VerifyCuts : public testing::Test {
 protected:
  /// Builds a hierarchy of several levels.
  PatchFile build(const support::Mesh& mesh) {
    const auto built = support::buildHierarchy(mesh, support::smallPatches(), directory_ / "patch.lgp");
    EXPECT_TRUE(built) << built.error().message;
    return open("patch.lgp");
  }

  /// The same hierarchy with the geometry of patches above the leaves changed.
  PatchFile damage(const PatchFile& file, const std::function<void(PatchGeometry&)>& change) {
    const auto written = lod::patch::writePatchFile(
        directory_ / "damaged.lgp", file.hierarchy(), [&](std::uint32_t g) -> base::Result<std::vector<base::Bytes>> {
          const lod::patch::Group& group = file.hierarchy().groups[g];
          std::vector<base::Bytes> block;
          for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
            LUMIGRID_ASSIGN_OR_RETURN(auto geometry, file.geometry(p));
            if (file.hierarchy().patches[p].level > 0) change(geometry);
            block.push_back(lod::patch::encodePatch(geometry));
          }
          return block;
        });
    EXPECT_TRUE(written) << written.error().message;
    return open("damaged.lgp");
  }

  static CutReport verify(const PatchFile& file, std::uint32_t count = 20, std::uint64_t seed = 7) {
    auto report = verifyCuts(file, count, seed, nullptr);
    EXPECT_TRUE(report) << report.error().message;
    return report ? std::move(*report) : CutReport{};
  }

 private:
  PatchFile open(const char* name) const {
    auto file = PatchFile::open(directory_ / name);
    EXPECT_TRUE(file) << file.error().message;
    return file ? std::move(*file) : PatchFile();
  }

  const support::TemporaryDirectory directory_;
};

TEST_F(VerifyCuts, cutsOfAClosedMeshAreClosedAndManifold) {
  const CutReport report = verify(build(support::torus(150, 90)));
  EXPECT_EQ(report.source.triangles, 2U * 150 * 90);
  EXPECT_EQ(report.source.open_edges, 0U);
  EXPECT_EQ(report.source.non_manifold_vertices, 0U);
  ASSERT_EQ(report.cuts.size(), 20U);
  std::uint64_t smallest = report.source.triangles, largest = 0;
  for (const CutTopology& cut : report.cuts) {
    EXPECT_EQ(cut.open_edges, 0U);
    EXPECT_EQ(cut.non_manifold_vertices, 0U);
    EXPECT_EQ(cut.inconsistent_edges, 0U);
    smallest = std::min(smallest, cut.triangles);
    largest = std::max(largest, cut.triangles);
  }
  EXPECT_TRUE(report.faults.empty()) << report.faults.front();
  EXPECT_GT(largest, 4 * smallest) << "the cuts are too much alike to say much";
}

TEST_F(VerifyCuts, theSimplifiedBorderOfAnOpenMeshIsNoFault) {
  const CutReport report = verify(build(support::openGrid(120)));
  EXPECT_EQ(report.source.open_edges, 480U);
  std::uint64_t simplified = 0;
  for (const CutTopology& cut : report.cuts) simplified += cut.open_edges < 480 ? 1 : 0;
  EXPECT_GT(simplified, 10U);
  EXPECT_TRUE(report.faults.empty()) << report.faults.front();
}

TEST_F(VerifyCuts, theSameSeedGivesTheSameCuts) {
  const PatchFile file = build(support::torus(90, 60));
  EXPECT_EQ(cutsAsText(verify(file, 5, 3)), cutsAsText(verify(file, 5, 3)));
  EXPECT_NE(cutsAsText(verify(file, 5, 3)), cutsAsText(verify(file, 5, 4)));
}

TEST_F(VerifyCuts, aMovedVertexIsACrack) {
  const PatchFile file = damage(build(support::torus(150, 90)), [](PatchGeometry& g) { g.positions[0].x += 50; });
  const CutReport report = verify(file);
  EXPECT_EQ(report.source.open_edges, 0U);
  ASSERT_FALSE(report.faults.empty());
  EXPECT_NE(report.faults[0].find("open edges"), std::string::npos) << report.faults[0];
}

TEST_F(VerifyCuts, aFlippedPatchIsAFault) {
  for (const support::Mesh& mesh : {support::torus(150, 90), support::openGrid(120)}) {
    const PatchFile file = damage(build(mesh), [](PatchGeometry& g) {
      for (std::size_t i = 0; i + 2 < g.indices.size(); i += 3) std::swap(g.indices[i], g.indices[i + 1]);
    });
    const CutReport report = verify(file);
    ASSERT_FALSE(report.faults.empty());
    EXPECT_NE(report.faults[0].find("opposite orientation"), std::string::npos) << report.faults[0];
  }
}

TEST_F(VerifyCuts, aNonManifoldSourceIsReportedAndItsCutsAreNoFault) {
  // The two tori touch in one vertex.
  support::Mesh mesh = support::torus(60, 40);
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  const auto rightmost = std::max_element(mesh.positions.begin(), mesh.positions.end(),
                                          [](const glm::vec3& a, const glm::vec3& b) { return a.x < b.x; });
  const float x = rightmost->x;
  for (std::uint32_t i = 0; i < first; ++i) {
    const glm::vec3 p = mesh.positions[i];
    mesh.positions.push_back({2.0F * x - p.x, p.y, p.z});
  }
  for (std::size_t i = 0, n = mesh.indices.size(); i < n; i += 3)
    support::addTriangle(mesh, first + mesh.indices[i], first + mesh.indices[i + 2], first + mesh.indices[i + 1]);
  mesh.colors.clear();
  const CutReport report = verify(build(mesh));
  EXPECT_EQ(report.source.open_edges, 0U);
  EXPECT_GE(report.source.non_manifold_vertices, 1U);
  EXPECT_TRUE(report.faults.empty()) << report.faults.front();
}

}  // namespace
}  // namespace server::cli
