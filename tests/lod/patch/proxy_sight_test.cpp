#include "lod/patch/proxy_sight.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/camera.h"
#include "lod/patch/ray_cast.h"
#include "tests/lod/patch/built_scene.h"

namespace lod::patch {
namespace {

// castRay() intersects the same cut by another algorithm, and both must agree.
TEST(ProxySight, meetsWhatARayMeetsInTheSameCut) {
  const BuiltScene scene(support::torus(80, 60), "sight");
  const UniformCut cut = selectFinestUniformCut(scene.hierarchy(), 3000);
  ASSERT_LE(cut.cut.triangles, 3000U);
  const auto sight = ProxySight::ofFile(scene.file(), 3000);
  ASSERT_TRUE(sight) << sight.error().message;
  EXPECT_EQ(sight->triangleCount(), cut.cut.triangles);
  EXPECT_EQ(sight->error(), cut.error);
  EXPECT_GT(sight->error(), 0.0F);

  RandomRays rays(scene.file());
  int hits = 0;
  for (int i = 0; i < 2000; ++i) {
    const Ray drawn = rays.next();
    const glm::vec3 origin(drawn.origin);
    const glm::vec3 direction(glm::normalize(drawn.direction));
    const auto expected =
        castRay(scene.hierarchy(), {glm::dvec3(origin), glm::dvec3(direction)}, blocksOf(scene.file()), cut.error);
    ASSERT_TRUE(expected);
    const auto met = sight->nearest(origin, direction, 1e9F);
    ASSERT_EQ(met.has_value(), expected->hit.has_value()) << i;
    if (!met) continue;
    ++hits;
    const auto distance = static_cast<float>(expected->hit->distance);
    EXPECT_NEAR(met->distance, distance, 1e-5F * (1.0F + distance));

    // A line is blocked if it ends behind the intersection, and not if it ends before.
    const glm::vec3 before = origin + 0.99F * distance * direction;
    const glm::vec3 behind = origin + (1.01F * distance + 0.01F) * direction;
    EXPECT_FALSE(sight->isBlocked(origin, before, 0.0F));
    EXPECT_TRUE(sight->isBlocked(origin, behind, 0.0F));
    EXPECT_TRUE(sight->isBlocked(behind, origin, 0.0F));
  }
  EXPECT_GT(hits, 500);
}

TEST(ProxySight, leavesWhatIsNearTheEndsOutOfIt) {
  const BuiltScene scene(support::openGrid(40, 0.0F), "clearance");
  const auto sight = ProxySight::ofFile(scene.file());
  ASSERT_TRUE(sight);
  const glm::vec3 above(0.4F, 0.3F, 0.5F), below(0.4F, 0.3F, -0.1F);
  EXPECT_TRUE(sight->isBlocked(above, below, 0.0F));
  EXPECT_TRUE(sight->isBlocked(above, below, 0.09F));
  EXPECT_FALSE(sight->isBlocked(above, below, 0.11F));
  EXPECT_FALSE(sight->isBlocked(below, above, 0.11F));
  EXPECT_FALSE(sight->isBlocked(above, above, 0.0F));
  // Beside the square nothing is in the way.
  EXPECT_FALSE(sight->isBlocked(above + glm::vec3(1.0F, 0.0F, 0.0F), below + glm::vec3(1.0F, 0.0F, 0.0F), 0.0F));
}

TEST(ProxySight, noClosedSurfaceLetsALineThrough) {
  const BuiltScene scene(support::bumpySphere(40, 60), "closed");
  const auto sight = ProxySight::ofFile(scene.file(), 1000);
  ASSERT_TRUE(sight);
  RandomRays rays(scene.file());
  for (int i = 0; i < 5000; ++i)
    ASSERT_TRUE(sight->isBlocked(glm::vec3(0.2 * rays.unit()), glm::vec3(4.0 * rays.unit()), 0.0F)) << i;
}

TEST(ProxySight, emptyCutHidesNothing) {
  const BuiltScene scene(support::torus(20, 20), "nothing");
  const auto none = ProxySight::ofPatches(scene.hierarchy(), {}, 0.0F,
                                          [&](std::uint32_t patch) { return scene.file().geometry(patch); });
  ASSERT_TRUE(none);
  EXPECT_FALSE(none->isBlocked(glm::vec3(-9.0F), glm::vec3(9.0F), 0.0F));
  EXPECT_FALSE(none->nearest(glm::vec3(0.0F), glm::vec3(1.0F, 0.0F, 0.0F), 100.0F));
  const std::vector<std::uint32_t> first{0};
  EXPECT_FALSE(ProxySight::ofPatches(scene.hierarchy(), first, 0.0F, [](std::uint32_t) -> base::Result<PatchGeometry> {
    return base::Error{base::ErrorCode::kNotFound, "not here"};
  }));
}

}  // namespace
}  // namespace lod::patch
