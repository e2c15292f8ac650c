// Scans from the world, found through LUMIGRID_MESHES (a folder); without it these tests are skipped.
#include <cstdlib>
#include <fstream>

#include "tests/mesh/mesh_files.h"

namespace {

using namespace mesh_files;

struct RealMesh {
  std::string name;
  std::uint64_t triangles;  // as the file says

  friend void PrintTo(const RealMesh& mesh, std::ostream* out) { *out << mesh.name; }
};

class RealMeshes : public testing::TestWithParam<RealMesh> {};

// Directed edges as sorted 64-bit numbers: a map of millions would take minutes.
std::vector<std::uint64_t> sortedEdges(const Mesh& mesh) {
  std::vector<std::uint64_t> edges;
  edges.reserve(mesh.indices.size());
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3)
    for (std::size_t k = 0; k < 3; ++k)
      edges.push_back((std::uint64_t{mesh.indices[i + k]} << 32U) | mesh.indices[i + (k + 1) % 3]);
  std::sort(edges.begin(), edges.end());
  return edges;
}

TEST_P(RealMeshes, ComeInCleanAndLoseNothingUncounted) {
  const char* folder = std::getenv("LUMIGRID_MESHES");
  if (folder == nullptr) GTEST_SKIP() << "LUMIGRID_MESHES names no folder of scans";
  const std::string path = std::string(folder) + "/" + GetParam().name;
  if (!std::ifstream(path)) GTEST_SKIP() << path << " is not there";

  auto result = mesh::importMeshes({path}, {});
  ASSERT_TRUE(result) << result.error().message;
  const Mesh& mesh = result->mesh;
  EXPECT_EQ(result->sources[0].triangles, GetParam().triangles);
  EXPECT_EQ(mesh.triangleCount() + count(*result, "degenerate_triangles") + count(*result, "duplicate_triangles"),
            GetParam().triangles);

  // No edge is run along twice in one direction; indices in range; all vertices used.
  const std::vector<std::uint64_t> edges = sortedEdges(mesh);
  EXPECT_EQ(std::adjacent_find(edges.begin(), edges.end()), edges.end());
  std::vector<bool> used(mesh.positions.size(), false);
  for (const std::uint32_t i : mesh.indices) {
    ASSERT_LT(i, used.size());
    used[i] = true;
  }
  EXPECT_EQ(std::count(used.begin(), used.end(), false), 0);
  EXPECT_EQ(mesh.normals.size(), mesh.positions.size());
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
