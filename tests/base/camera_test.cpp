#include "base/camera.h"

#include <gtest/gtest.h>

#include <cmath>

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

TEST(Camera, viewsThatDifferByRoundingShowTheSame) {
  base::ViewCamera view;
  view.position = {500'000.1, 5'000'000.2, 300.3};
  view.direction = glm::normalize(glm::dvec3(1.0, 2.0, -3.0));
  view.up = {0.0, 0.0, 1.0};
  base::ViewCamera other = view;
  other.position = view.position * 0.3 + view.position * 0.7;
  other.direction = glm::normalize(view.direction * 3.0);
  EXPECT_TRUE(base::showsSameView(view, other));
  other.position.x += 1e-4;
  EXPECT_FALSE(base::showsSameView(view, other)) << "a tenth of a millimetre";
  other = view;
  other.direction = glm::normalize(view.direction + glm::dvec3(1e-7, 0.0, 0.0));
  EXPECT_FALSE(base::showsSameView(view, other));
  other = view;
  other.ortho_height = 2.0;
  EXPECT_FALSE(base::showsSameView(view, other));
  other = view;
  other.section = base::SectionPlane{};
  EXPECT_FALSE(base::showsSameView(view, other));
}

TEST(Camera, projectedErrorIsThePixelsThatALengthCovers) {
  const base::ViewCamera view = lookingDown();
  const base::Camera camera = base::cameraFromView(view, view.position - glm::dvec3(0, 0, 20), 0.1F, 100.0F);
  // A length of 1 is seen face-on at 20 units. Its size in pixels is the difference of two projected points.
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
    const auto range = base::depthRangeFor(glm::vec3(distance, 0, 0), {glm::vec3(0.0F), 3.0F}, 1.0F);
    EXPECT_GT(range.near_plane, 0.0F);
    EXPECT_GE(range.far_plane, distance + 3.0F);
    EXPECT_TRUE(distance <= 4.0F || range.near_plane <= distance - 3.0F);
  }
}

// A point in a corner of the picture is nearer to the eye's plane than to the eye; a wall there was cut open once.
TEST(Camera, nothingInACornerIsInFrontOfTheNearPlane) {
  const base::Sphere scene{glm::vec3(0.0F), 3.0F};
  for (const double fov_degrees : {20.0, 60.0, 90.0, 150.0}) {
    base::ViewCamera view = lookingDown();
    view.fov_y = glm::radians(fov_degrees);
    // The ray to the scene's middle runs through the picture's upper right corner.
    const double up = std::tan(0.5 * view.fov_y);
    const double aside = up * view.width / view.height;
    const glm::dvec3 right = glm::normalize(glm::cross(view.direction, view.up));
    const glm::dvec3 over = glm::cross(right, view.direction);
    const glm::dvec3 through = glm::normalize(view.direction + aside * right + up * over);
    view.position = -7.0 * through;
    const base::Camera camera = base::cameraForScene(view, glm::dvec3(0.0), scene);
    const glm::vec4 nearest = camera.clipFromScene() * glm::vec4(-3.0 * through, 1.0F);
    EXPECT_GE(nearest.z, -nearest.w) << fov_degrees;
    EXPECT_LE(nearest.z, nearest.w) << fov_degrees;
  }
}

TEST(Camera, orthographicPixelsAreAsWideAtEveryDistance) {
  base::ViewCamera view = lookingDown();
  view.ortho_height = 30.0;
  const base::Camera camera = base::cameraForScene(view, {500'000.0, 4'000'000.0, 100.0}, {glm::vec3(0.0F), 10.0F});
  EXPECT_TRUE(camera.orthographic());
  EXPECT_FLOAT_EQ(camera.pixelsPerUnitAtOne(), 20.0F);  // 600 pixels over 30 units
  for (const float z : {-9.0F, 0.0F, 9.0F}) {
    const glm::vec4 p = camera.clipFromScene() * glm::vec4(15.0F, 7.5F, z, 1.0F);
    EXPECT_FLOAT_EQ(p.w, 1.0F);
    EXPECT_NEAR(p.x * 400.0F, 300.0F, 1e-2F);
    EXPECT_NEAR(p.y * 300.0F, 150.0F, 1e-2F);
    EXPECT_LT(std::abs(p.z), 1.0F) << "all of the scene is between the planes";
    EXPECT_NEAR(glm::length(camera.towardsViewer(glm::vec3(3.0F, 2.0F, z)) - glm::vec3(0, 0, 1)), 0.0F, 1e-6F);
    EXPECT_NEAR(camera.pixelsPerUnit(glm::vec3(3.0F, 2.0F, z)), 20.0F, 1e-4F);
  }
  EXPECT_FLOAT_EQ(base::projectedError(0.5F, {glm::vec3(0, 0, 9), 1.0F}, camera, 0.1F), 10.0F);
}

TEST(Camera, perspectiveScalesDivideByTheDistanceToTheEye) {
  const base::ViewCamera view = lookingDown();
  const base::Camera camera = base::cameraForScene(view, {500'000.0, 4'000'000.0, 100.0}, {glm::vec3(0.0F), 10.0F});
  EXPECT_FALSE(camera.orthographic());
  EXPECT_NEAR(glm::length(camera.towardsViewer(glm::vec3(0.0F)) - glm::vec3(0, 0, 20)), 0.0F, 1e-5F);
  EXPECT_FLOAT_EQ(camera.pixelsPerUnit(glm::vec3(0.0F)), camera.pixelsPerUnitAtOne() / 20.0F);
  EXPECT_FLOAT_EQ(base::projectedError(1.0F, {glm::vec3(0.0F), 2.0F}, camera, 0.1F),
                  base::projectedError(1.0F, glm::vec3(0.0F), 2.0F, camera.eye, camera.pixelsPerUnitAtOne(), 0.1F));
}

TEST(Camera, orthographicPictureDoesNotDependOnThePositionAlongItsAxis) {
  base::ViewCamera view = lookingDown();
  view.ortho_height = 5.0;
  const glm::dvec3 origin(500'000.0, 4'000'000.0, 100.0);
  const glm::mat4 clip = base::cameraForScene(view, origin, {glm::vec3(0.0F), 10.0F}).clipFromScene();
  view.position.z -= 1234.0;
  EXPECT_EQ(base::cameraForScene(view, origin, {glm::vec3(0.0F), 10.0F}).clipFromScene(), clip);
}

TEST(Camera, standInShowsWhatTheOrthographicViewShows) {
  base::ViewCamera view = lookingDown();
  const glm::dvec3 center(500'001.0, 4'000'002.0, 100.0);
  for (const double height : {100.0, 20.0, 1.0, 0.05}) {
    view.ortho_height = height;
    const base::ViewCamera stand_in = base::perspectiveStandIn(view, center, 10.0);
    EXPECT_FALSE(stand_in.orthographic());
    EXPECT_EQ(stand_in.direction, view.direction);
    EXPECT_GE(stand_in.fov_y, 1e-3);
    EXPECT_LT(stand_in.fov_y, 3.0);
    EXPECT_NEAR(stand_in.position.x, view.position.x, 1e-6);
    const double nearest = stand_in.position.z - center.z - 10.0;
    EXPECT_GT(nearest, 0.0) << "outside the scene";
    EXPECT_GE(2.0 * nearest * std::tan(0.5 * stand_in.fov_y), 0.999 * height);
  }
  view.ortho_height = 0.0;
  EXPECT_EQ(base::perspectiveStandIn(view, center, 10.0).position, view.position);
}

TEST(Section, cutsTheSameInSceneAndWorldCoordinates) {
  const glm::dvec3 origin(500'000.0, 4'000'000.0, 100.0);
  const glm::vec4 section = base::sectionInScene({{0.0, 0.0, 3.0}, 3.0 * 101.5}, origin);
  EXPECT_NEAR(glm::length(section - glm::vec4(0, 0, 1, 1.5F)), 0.0F, 1e-6F);
  EXPECT_EQ(base::sectionInScene({{0.0, 0.0, 0.0}, 1.0}, origin), base::kNoSection);
  EXPECT_EQ(base::sectionInScene({{0.0, 0.0, 1.0}, std::nan("")}, origin), base::kNoSection);
  base::ViewCamera view = lookingDown();
  EXPECT_FALSE(base::cameraFromView(view, origin, 0.1F, 100.0F).hasSection());
  view.section = base::SectionPlane{{0.0, 0.0, 1.0}, 101.5};
  const base::Camera camera = base::cameraFromView(view, origin, 0.1F, 100.0F);
  EXPECT_TRUE(camera.hasSection());
  EXPECT_EQ(camera.section, section);
}

}  // namespace
