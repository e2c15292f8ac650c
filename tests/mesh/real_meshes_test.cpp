// Real scans in the folder LUMIGRID_MESHES; without it these tests are skipped. OpenMesh reads them as a second way.
#include <cstdlib>
#include <fstream>

#include "tests/mesh/mesh_files.h"
#include "tests/support/open_mesh.h"

namespace {

using namespace mesh_files;

struct RealMesh {
  std::string name;
  std::uint64_t triangles;  // the file's count

  friend void PrintTo(const RealMesh& mesh, std::ostream* out) { *out << mesh.name; }
};

class RealMeshes : public testing::TestWithParam<RealMesh> {};

TEST_P(RealMeshes, haveTheTrianglesThatOpenMeshReads) {
  const char* folder = std::getenv("LUMIGRID_MESHES");
  if (folder == nullptr) GTEST_SKIP() << "LUMIGRID_MESHES names no folder of scans";
  const std::string path = std::string(folder) + "/" + GetParam().name;
  if (!std::ifstream(path)) GTEST_SKIP() << path << " is not there";

  const auto ours = support::readMesh(path);
  ASSERT_TRUE(ours) << ours.error().message;
  EXPECT_EQ(ours->file.triangles + ours->file.short_faces, GetParam().triangles);
  EXPECT_EQ(ours->mesh.normals.size(), ours->mesh.positions.size());
  for (const std::uint32_t i : ours->mesh.indices) ASSERT_LT(i, ours->mesh.positions.size());

  const auto theirs = support::readByOpenMesh(path);
  ASSERT_TRUE(theirs);
  const double area = support::areaOf(ours->mesh);
  EXPECT_NEAR(support::areaOf(*theirs), area, 1e-4 * area);
  EXPECT_NEAR(static_cast<double>(theirs->triangleCount()), static_cast<double>(ours->file.triangles),
              1e-3 * static_cast<double>(ours->file.triangles));
}

INSTANTIATE_TEST_SUITE_P(Scans, RealMeshes,
                         testing::Values(RealMesh{"bun_zipper.ply", 69451}, RealMesh{"lucy_100k.ply", 99970},
                                         RealMesh{"skull.obj", 100002}, RealMesh{"mountain.obj", 50562},
                                         RealMesh{"pizza.obj", 49954}, RealMesh{"cedar_creek.ply", 1091591},
                                         RealMesh{"refinery_shihua.ply", 1249431}, RealMesh{"machangara.ply", 3029285}),
                         [](const auto& scan) {
                           std::string name = scan.param.name;
                           std::replace(name.begin(), name.end(), '.', '_');
                           return name;
                         });

}  // namespace
