#include "base/camera.h"

#include <gtest/gtest.h>

namespace {

base::ViewCamera lookingDown() {
  base::ViewCamera view;
  view.position = {500'000.0, 4'000'000.0, 120.0};
  view.direction = {0, 0, -1};
  view.up = {0, 1, 0};
  view.fov_y = 0.9;
  view.width = 800;
  view.height = 600;
  return view;
}

TEST(Camera, surveyCoordinatesKeepTheirMillimetres) {
  const base::ViewCamera view = lookingDown();
  const base::Camera camera = base::cameraFromView(view, {500'000.0, 4'000'000.0, 100.0}, 0.1F, 100.0F);
  const glm::vec4 a = camera.clipFromScene() * glm::vec4(0.001F, 0, 0, 1);
  EXPECT_NEAR(a.x / a.w * 400.0F, 0.001F / 20.0F * camera.pixelsPerUnitAtOne(), 1e-4F);
}

TEST(Camera, projectedErrorIsThePixelsThatALengthCovers) {
  const base::ViewCamera view = lookingDown();
  const base::Camera camera = base::cameraFromView(view, view.position - glm::dvec3(0, 0, 20), 0.1F, 100.0F);
  // A length of 1 seen face-on at 20 units: the difference of two projected points, in pixels.
  const glm::vec4 a = camera.clipFromScene() * glm::vec4(0, 0, 0, 1);
  const glm::vec4 b = camera.clipFromScene() * glm::vec4(0, 1, 0, 1);
  const float pixels = (b.y / b.w - a.y / a.w) * 300.0F;
  EXPECT_NEAR(base::projectedError(1.0F, glm::vec3(0, 0, -2), 2.0F, camera.eye, camera.pixelsPerUnitAtOne(), 0.1F),
              pixels, 0.01F);
}

TEST(Camera, projectedErrorGrowsTowardsTheEyeAndStaysFiniteInside) {
  float last = 0.0F;
  for (float z = 100.0F; z >= 0.0F; z -= 1.0F) {
    const float now = base::projectedError(0.1F, glm::vec3(0, 0, -z), 1.0F, glm::vec3(0.0F), 500.0F, 0.01F);
    EXPECT_GE(now, last);
    EXPECT_TRUE(std::isfinite(now));
    last = now;
  }
}

TEST(Camera, depthRangeHoldsTheWholeScene) {
  for (float distance : {0.0F, 1.0F, 5.0F, 100.0F, 10000.0F}) {
    const auto range = base::depthRangeFor(glm::vec3(distance, 0, 0), glm::vec3(0.0F), 3.0F);
    EXPECT_GT(range.near_plane, 0.0F);
    EXPECT_GE(range.far_plane, distance + 3.0F);
    EXPECT_TRUE(distance <= 4.0F || range.near_plane <= distance - 3.0F);
  }
}

}  // namespace
