#include "lod/build/distance_bound.h"

#include <gtest/gtest.h>

#include "tests/support/surface_distance.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::build;

struct Bounded {
  float bound = 0.0F;
  double sampled = 0.0;
};

Bounded simplifyAndBound(const Mesh& mesh, float scale, double share, float negligible = 0.01F) {
  GroupMesh group;
  for (const glm::vec3& p : mesh.positions) group.positions.push_back(glm::round((p + 2.0F) * scale));
  group.normals.assign(group.positions.size(), glm::vec3(0, 0, 1));
  group.locked.assign(group.positions.size(), 0);
  group.indices = mesh.indices;
  const support::Surface before{group.positions, group.indices};
  const std::vector<std::uint32_t> indices = group.indices;
  const Simplified out =
      simplifyGroup(group, static_cast<std::size_t>(share * static_cast<double>(mesh.triangleCount())));
  const support::Surface after{group.positions, out.indices};
  Bounded result;
  result.bound = distanceBound({before.positions, before.indices}, {after.positions, after.indices}, out, negligible);
  const support::NearestSurface to_before(before);
  const support::NearestSurface to_after(after);
  result.sampled = std::max(support::sampledDistance(before, to_after, 30000).max,
                            support::sampledDistance(after, to_before, 30000).max);
  return result;
}

TEST(DistanceBound, HoldsAndIsTightOnMeshesOfEveryKind) {
  for (const Mesh& mesh : {support::bumpySphere(40, 60), support::torus(50, 40), support::openGrid(45)}) {
    for (const double share : {0.5, 0.25, 0.1}) {
      const Bounded b = simplifyAndBound(mesh, 800.0F, share);
      EXPECT_GE(b.bound, b.sampled) << share;
      EXPECT_LE(b.bound, 1.5 * b.sampled + 0.5) << share;
    }
  }
}

TEST(DistanceBound, HoldsWhereComponentsVanish) {
  for (const Mesh& mesh : {support::triangleSoup(1500), support::tinyComponents(400)}) {
    const Bounded b = simplifyAndBound(mesh, 20000.0F, 0.4);
    EXPECT_GE(b.bound, b.sampled);
    EXPECT_LE(b.bound, 1.5 * b.sampled);
  }
}

TEST(DistanceBound, OfAFlatSheetIsNearNothing) {
  const Bounded b = simplifyAndBound(support::openGrid(40, 0.0F), 800.0F, 0.1);
  EXPECT_LT(b.bound, 0.1F);
}

TEST(DistanceBound, IsNeverBelowWhatIsNegligibleAndZeroForNoChange) {
  EXPECT_GE(simplifyAndBound(support::bumpySphere(20, 20), 300.0F, 0.9, 7.0F).bound, 7.0F);
  EXPECT_EQ(simplifyAndBound(support::bumpySphere(20, 20), 300.0F, 1.0).bound, 0.0F);
}

}  // namespace
