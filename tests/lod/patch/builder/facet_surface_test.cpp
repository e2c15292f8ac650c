#include "lod/patch/builder/facet_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/geometry.h"

namespace {

using namespace lod::patch::builder;

// Triangles with corners on a lattice, from well-shaped ones to needles and triangles without area.
struct Triangles {
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> indices;
  FacetSurface surface;
  Triangles() {
    std::mt19937 random(11);
    std::uniform_int_distribution<int> at(0, 4000);
    const auto point = [&] { return glm::vec3(at(random), at(random), at(random)); };
    for (int i = 0; i < 300; ++i) {
      const glm::vec3 a = point();
      const glm::vec3 b = i % 5 == 3 ? a + glm::vec3(1, 2, i % 3) : point();
      const glm::vec3 c = i % 5 == 4 ? a + 2.0F * (b - a) : i % 7 == 5 ? b + glm::vec3(i % 2, 1, 0) : point();
      for (const glm::vec3& p : {a, b, c}) {
        indices.push_back(static_cast<std::uint32_t>(positions.size()));
        positions.push_back(p);
      }
    }
    surface.reset({positions, indices});
  }
};

TEST(Facet, itsDistanceIsThatOfTheClosestPoint) {
  Triangles of;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> at(-2000.0F, 6000.0F);
  std::size_t thin = 0;
  std::size_t flat = 0;
  std::size_t over = 0;
  for (std::uint32_t t = 0; t < of.surface.triangleCount(); ++t) {
    const Facet& facet = of.surface.facet(t);
    thin += facet.thin ? 1 : 0;
    flat += facet.flat ? 1 : 0;
    for (int i = 0; i < 50; ++i) {
      const glm::dvec3 a(facet.corner(0));
      const glm::dvec3 b(facet.corner(1));
      const glm::dvec3 c(facet.corner(2));
      // Half of the points lie near the middle; else few would lie over the triangle.
      const glm::vec3 any(at(random), at(random), at(random));
      const glm::vec3 p = i % 2 == 0 ? any : glm::vec3((a + b + c) / 3.0) + 0.05F * any;
      const double wanted = glm::distance(glm::dvec3(p), base::closestPointOnTriangle(glm::dvec3(p), a, b, c));
      // The distance to a thin facet is that to its border, which is wrong by less than its width.
      const double slack = facet.thin ? 2.4e-3 * static_cast<double>(facet.longest) : 0.0;
      EXPECT_NEAR(std::sqrt(facet.distance2(p)), wanted, 2e-3 + 1e-5 * wanted + slack) << "triangle " << t;
      if (facet.flat) continue;

      // Walls and plane, lane by lane.
      const Facet::Four inside = facet.inside(p);
      const double reach = glm::distance(glm::dvec3(p), a) + static_cast<double>(facet.longest);
      const auto near = static_cast<double>(facet.roughness) * reach + 1e-3;
      const glm::dvec3 normal = glm::normalize(glm::cross(b - a, c - a));
      EXPECT_NEAR(inside[3], glm::dot(normal, glm::dvec3(p) - a), near);
      const glm::dvec3 corners[3] = {a, b, c};
      for (std::size_t k = 0; k < 3 && !facet.thin; ++k) {
        const glm::dvec3 edge = corners[(k + 1) % 3] - corners[k];
        const glm::dvec3 wall = glm::normalize(glm::cross(normal, edge));
        EXPECT_NEAR(inside[k], glm::dot(wall, glm::dvec3(p) - corners[k]), near) << "wall " << k;
      }
      over += Facet::wallsWhere(inside >= 0.0F) == 7 ? 1 : 0;
    }
  }
  EXPECT_GT(thin, 50U);
  EXPECT_GT(flat, 20U);
  EXPECT_GT(over, 1000U);
}

TEST(Facet, distancesToItsEdgesAreThoseToSegments) {
  Triangles of;
  std::mt19937 random(4);
  std::uniform_real_distribution<float> at(-2000.0F, 6000.0F);
  for (std::uint32_t t = 0; t < of.surface.triangleCount(); ++t) {
    const Facet& facet = of.surface.facet(t);
    for (int i = 0; i < 20; ++i) {
      const glm::vec3 p(at(random), at(random), at(random));
      const Facet::Four found2 = facet.edgeDistances2(p);
      for (std::size_t k = 0; k < 3; ++k) {
        const glm::dvec3 a(facet.corner(k));
        const glm::dvec3 ab = glm::dvec3(facet.corner((k + 1) % 3)) - a;
        const double length2 = glm::dot(ab, ab);
        const double share = length2 > 0.0 ? std::clamp(glm::dot(glm::dvec3(p) - a, ab) / length2, 0.0, 1.0) : 0.0;
        const double wanted = glm::distance(glm::dvec3(p), a + share * ab);
        EXPECT_NEAR(std::sqrt(found2[k]), wanted, 1e-3 + 1e-5 * wanted) << "edge " << k << " of triangle " << t;
      }
    }
  }
}

TEST(Facet, wallsAreTheLowestThreeBits) {
  const Facet::Four some{-1.0F, 2.0F, -3.0F, -4.0F};
  EXPECT_EQ(Facet::wallsWhere(some < 0.0F), 5U);
  EXPECT_EQ(Facet::wallsWhere(some >= 0.0F), 2U);
  EXPECT_EQ(Facet::wallsWhere(some < -9.0F), 0U);
}

}  // namespace
