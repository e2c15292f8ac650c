#include "server/views/enclosed.h"

#include <gtest/gtest.h>

#include <utility>

#include "tests/server/bake/sphere.h"

namespace server {
namespace {

std::vector<test::Triangle> turnedInsideOut(std::vector<test::Triangle> triangles) {
  for (test::Triangle& t : triangles) std::swap(t.b, t.c);
  return triangles;
}

TEST(Enclosed, aClosedSurfaceEnclosesItsInside) {
  const test::TwoLevelScene scene(test::sphere(6, -1.0F, 1.0F),
                                  {test::sphere(16, -1.0F, 0.0F), test::sphere(16, 0.0F, 1.0F)}, 0.1F);
  const auto enclosure = Enclosure::create(scene.file());
  ASSERT_TRUE(enclosure) << enclosure.error().message;
  EXPECT_NEAR(enclosure->windingNumber({0.1F, -0.2F, 0.3F}), 1.0, 1e-3);
  EXPECT_NEAR(enclosure->windingNumber({0.9F, 0.8F, 0.3F}), 0.0, 1e-3);
  const std::vector<glm::vec3> points{{0, 0, 0}, {0, 0, 0.9F}, {0, 0, 1.1F}, {3, 2, 1}, {0.5F, 0.5F, 0.5F}, {1, 1, 1}};
  EXPECT_EQ(enclosedPoints(*enclosure, points, 2), (std::vector<std::uint8_t>{1, 1, 0, 0, 1, 0}));
}

// The coarse cut's error is a tenth, so points within a tenth of it may be outside.
TEST(Enclosed, withinTheErrorOfACoarseCutNothingIsEnclosed) {
  const test::TwoLevelScene scene(test::sphere(6, -1.0F, 1.0F),
                                  {test::sphere(16, -1.0F, 0.0F), test::sphere(16, 0.0F, 1.0F)}, 0.1F);
  const auto enclosure = Enclosure::create(scene.file(), 200);
  ASSERT_TRUE(enclosure);
  EXPECT_TRUE(enclosure->encloses({0.0F, 0.0F, 0.8F}));
  EXPECT_FALSE(enclosure->encloses({0.0F, 0.0F, 0.95F}));
}

TEST(Enclosed, aRoomDoesNotEncloseWhoIsInIt) {
  const auto room = turnedInsideOut(test::sphere(12, -1.0F, 1.0F));
  const test::TwoLevelScene inward(room, {room}, 0.1F);
  EXPECT_NEAR(Enclosure::create(inward.file())->windingNumber({0, 0, 0}), -1.0, 1e-3);
  EXPECT_FALSE(Enclosure::create(inward.file())->encloses({0, 0, 0}));
}

TEST(Enclosed, anOpenBowlDoesNot) {
  const auto bowl = test::sphere(12, -1.0F, 0.0F);
  const test::TwoLevelScene scene(bowl, {bowl}, 0.1F);
  EXPECT_NEAR(Enclosure::create(scene.file())->windingNumber({0, 0, 0}), 0.5, 0.05);
  EXPECT_FALSE(Enclosure::create(scene.file())->encloses({0, 0, -0.3F}));
  EXPECT_TRUE(Enclosure::create(scene.file())->isBehind({0, 0, -0.3F}));
  EXPECT_FALSE(Enclosure::create(scene.file())->isBehind({0, 0, -1.1F}));
  EXPECT_FALSE(Enclosure::create(scene.file())->isBehind({0, 0, 1.5F}));
}

}  // namespace
}  // namespace server
