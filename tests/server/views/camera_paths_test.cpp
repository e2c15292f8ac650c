// Tests the camera paths that are made for a scene.
#include <gtest/gtest.h>

#include "server/views/camera_paths.h"

namespace {

base::Scene sceneOf(const glm::dvec3& box_min, const glm::dvec3& box_max, const glm::dvec3& up) {
  base::Scene scene;
  scene.box_min = box_min;
  scene.box_max = box_max;
  scene.up = up;
  return scene;
}

TEST(Paths, lookAtTheSceneWhereverItLiesAndWhateverIsUp) {
  for (const auto& up : {glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1), glm::dvec3(1, 0, 0)}) {
    const base::Scene scene = sceneOf({5e5, 4e6, 100.0}, {5e5 + 80.0, 4e6 + 60.0, 130.0}, up);
    const glm::dvec3 center = 0.5 * (scene.box_min + scene.box_max);
    for (const std::string& name : server::pathNames()) {
      const auto path = server::makePath(name, scene, {});
      ASSERT_TRUE(path) << path.error().message;
      EXPECT_NEAR(path->seconds(), 12.0, 0.02) << name;
      for (const base::ViewCamera& view : path->frames) {
        EXPECT_NEAR(glm::length(view.direction), 1.0, 1e-9);
        EXPECT_LT(std::abs(glm::dot(view.direction, glm::normalize(view.up))), 0.999) << name;
        EXPECT_LT(glm::length(view.position - center), 3.0 * glm::length(scene.box_max - scene.box_min)) << name;
      }
    }
  }
  EXPECT_FALSE(server::makePath("stroll", sceneOf({}, glm::dvec3(1.0), {0, 1, 0}), {}));
}

TEST(Paths, moveEvenlyBetweenTheirFramesUnlessTheyJump) {
  const base::Scene scene = sceneOf(glm::dvec3(-1.0), glm::dvec3(1.0), {0, 1, 0});
  const auto orbit = server::makePath("orbit", scene, {});
  ASSERT_TRUE(orbit);
  const glm::dvec3 a = orbit->at(1.0).position, b = orbit->at(1.0 + 0.5 / 60.0).position,
                   c = orbit->at(1.0 + 1.0 / 60.0).position;
  EXPECT_NEAR(glm::length(b - 0.5 * (a + c)), 0.0, 1e-9);
  EXPECT_GT(glm::length(c - a), 0.0);
  EXPECT_EQ(orbit->at(1e6).position, orbit->frames.back().position);

  const auto jumps = server::makePath("teleports", scene, {});
  ASSERT_TRUE(jumps);
  EXPECT_EQ(jumps->at(0.1).position, jumps->at(1.9).position);
  EXPECT_NE(jumps->at(1.9).position, jumps->at(2.1).position);
}

TEST(Paths, whenFastTakeASixthOfTheTime) {
  const base::Scene scene = sceneOf(glm::dvec3(-1.0), glm::dvec3(1.0), {0, 1, 0});
  const auto slow = server::makePath("orbit", scene, {});
  const auto fast = server::makePath("orbit-fast", scene, {});
  ASSERT_TRUE(slow && fast);
  EXPECT_NEAR(glm::length(slow->at(6.0).position - fast->at(1.0).position), 0.0, 1e-9);
}

}  // namespace
