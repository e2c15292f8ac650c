#include "lod/patch/builder/facet_surface.h"

#include <gtest/gtest.h>

#include <random>

#include "base/geometry.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::patch::builder;
using support::Mesh;

TEST(FacetTree, findsTheNearestOfAll) {
  std::mt19937 random(5);
  for (const Mesh& mesh : {support::bumpySphere(20, 30), support::triangleSoup(700), support::tinyComponents(1)}) {
    std::vector<glm::vec3> positions;
    for (const glm::vec3& p : mesh.positions) positions.push_back(glm::round((p + 2.0F) * 1000.0F));
    FacetTree tree;
    tree.build(positions, mesh.indices);
    std::uniform_real_distribution<float> at(-1000.0F, 5000.0F);
    for (int i = 0; i < 300; ++i) {
      const glm::vec3 p(at(random), at(random), at(random));
      const auto distance2To = [&](std::uint32_t t) {
        const auto corner = [&](std::size_t k) { return glm::dvec3(positions[mesh.indices[3 * std::size_t{t} + k]]); };
        const glm::dvec3 d =
            base::closestPointOnTriangle(glm::dvec3(p), corner(0), corner(1), corner(2)) - glm::dvec3(p);
        return static_cast<float>(glm::dot(d, d));
      };
      float least2 = std::numeric_limits<float>::max();
      for (std::uint32_t t = 0; 3 * t < mesh.indices.size(); ++t) least2 = std::min(least2, distance2To(t));
      float found2 = std::numeric_limits<float>::max();
      const std::uint32_t found = tree.nearest(p, found2, 0.0F, distance2To);
      ASSERT_NE(found, FacetTree::kNone);
      EXPECT_EQ(distance2To(found), found2);
      EXPECT_NEAR(found2, least2, 1e-5F * least2);
      // Nothing is nearer than the nearest.
      EXPECT_EQ(tree.nearest(p, found2, 0.0F, distance2To), FacetTree::kNone);
      float near2 = std::numeric_limits<float>::max();
      EXPECT_NE(tree.nearest(p, near2, 4.0F * found2, distance2To), FacetTree::kNone);
      EXPECT_LE(near2, 4.0F * found2);
    }
  }
}

}  // namespace
