#include "lod/patch/proxy_sight.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/camera.h"
#include "lod/patch/ray_cast.h"
#include "lod/patch/ray_triangle.h"
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

// ---- the tree against all triangles one by one ----

struct Triangle {
  glm::vec3 a, b, c;
};

/// Triangles of all sizes with corners on a lattice, so that rays along it meet edges, corners and planes exactly.
class Heap {
 public:
  Heap() {
    hierarchy_.lattice = {glm::dvec3(-8.0), 0.25};
    for (int i = 0; i < 3000; ++i) {
      const int size = i % 100 == 0 ? 64 : 2 + i % 6;
      const auto draw = [&] { return glm::ivec3(at(size), at(size), at(size)); };
      const glm::ivec3 first = glm::ivec3(at(64), at(64), at(64)) + draw();
      glm::ivec3 second = first, third = first;
      // Where a triangle without area is met is a matter of rounding.
      while (glm::cross(glm::vec3(second - first), glm::vec3(third - first)) == glm::vec3(0.0F))
        second = first + draw(), third = first - draw();
      for (const glm::ivec3& corner : {first, second, third}) {
        geometry_.indices.push_back(static_cast<std::uint32_t>(geometry_.positions.size()));
        geometry_.positions.push_back(corner);
      }
    }
    for (std::size_t i = 0; i < geometry_.positions.size(); i += 3)
      triangles_.push_back({place(i), place(i + 1), place(i + 2)});
  }
  ProxySight sight() const {
    const std::vector<std::uint32_t> patches{0};
    return *ProxySight::ofPatches(hierarchy_, patches, 0.1F,
                                  [&](std::uint32_t) -> base::Result<PatchGeometry> { return geometry_; });
  }
  /// The nearest distance along the ray from `from` to `to`, in lengths of the direction.
  std::optional<double> nearest(const glm::dvec3& origin, const glm::dvec3& direction, double from, double to) const {
    const ShearedRay ray(origin, direction);
    std::optional<double> least;
    for (const Triangle& triangle : triangles_) {
      const auto met = ray.meets(glm::dvec3(triangle.a), glm::dvec3(triangle.b), glm::dvec3(triangle.c));
      if (met && met->distance >= from && met->distance <= to && (!least || met->distance < *least))
        least = met->distance;
    }
    return least;
  }
  const std::vector<Triangle>& triangles() const { return triangles_; }

  /// A place on the lattice, or anywhere.
  glm::vec3 drawPlace(bool on_lattice) {
    const glm::ivec3 step(at(80) - 8, at(80) - 8, at(80) - 8);
    return glm::vec3(-8.0F) +
           0.25F * (glm::vec3(step) + (on_lattice ? 0.0F : 0.01F) * glm::vec3(at(100), at(90), at(80)));
  }
  glm::vec3 drawDirection(bool along_an_axis) {
    glm::vec3 direction(0.0F);
    while (direction == glm::vec3(0.0F)) direction = glm::vec3(at(20) - 10, at(20) - 10, at(20) - 10);
    if (!along_an_axis) return glm::normalize(direction);
    glm::vec3 axis(0.0F);
    axis[at(3)] = at(2) == 0 ? 1.0F : -1.0F;
    return axis;
  }

 private:
  int at(int count) { return static_cast<int>(random_() % static_cast<unsigned>(count)); }
  glm::vec3 place(std::size_t i) const { return hierarchy_.lattice.position(geometry_.positions[i]); }

  std::mt19937 random_{7};
  Hierarchy hierarchy_;
  PatchGeometry geometry_;
  std::vector<Triangle> triangles_;
};

TEST(ProxySight, nearestIsThatOfAllTriangles) {
  Heap heap;
  const ProxySight sight = heap.sight();
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const glm::vec3 origin = heap.drawPlace(i % 2 == 0);
    const glm::vec3 direction = heap.drawDirection(i % 3 == 0);
    const auto met = sight.nearest(origin, direction, 30.0F);
    const auto expected = heap.nearest(glm::dvec3(origin), glm::dvec3(direction), 0.0, 30.0);
    ASSERT_EQ(met.has_value(), expected.has_value()) << i;
    if (!met) continue;
    ++hits;
    ASSERT_EQ(met->distance, static_cast<float>(*expected)) << i;
    const ProxySight::Cell& cell = sight.cell(met->cell);
    EXPECT_LE(glm::length(origin + met->distance * direction - cell.place), 1.001F * cell.radius) << i;
  }
  EXPECT_GT(hits, 1000);
}

TEST(ProxySight, aLineIsBlockedWhereAnyTriangleIsInTheWay) {
  Heap heap;
  const ProxySight sight = heap.sight();
  int blocked = 0;
  for (int i = 0; i < 3000; ++i) {
    const glm::vec3 from = heap.drawPlace(i % 2 == 0);
    const glm::vec3 to = i % 3 == 0 ? from + 4.0F * heap.drawDirection(true) : heap.drawPlace(i % 4 == 0);
    const float clearance = i % 5 == 0 ? 0.0F : 0.5F;
    const double length = glm::length(glm::dvec3(to) - glm::dvec3(from));
    const auto inset = static_cast<double>(clearance);
    const bool expected =
        length > 2.0 * inset &&
        heap.nearest(glm::dvec3(from), (glm::dvec3(to) - glm::dvec3(from)) / length, inset, length - inset).has_value();
    ASSERT_EQ(sight.isBlocked(from, to, clearance), expected) << i;
    blocked += expected ? 1 : 0;
  }
  EXPECT_GT(blocked, 500);
  EXPECT_LT(blocked, 2900);
}

TEST(ProxySight, cellsHoldAllTriangles) {
  const Heap heap;
  const ProxySight sight = heap.sight();
  EXPECT_GE(4 * sight.cellCount(), heap.triangles().size());
  EXPECT_LT(sight.cellCount(), heap.triangles().size());
  for (std::uint32_t cell = 0; cell < sight.cellCount(); ++cell) {
    EXPECT_TRUE(std::any_of(heap.triangles().begin(), heap.triangles().end(), [&](const Triangle& triangle) {
      return glm::length((triangle.a + triangle.b + triangle.c) / 3.0F - sight.cell(cell).place) < 1e-4F;
    }));
  }
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
