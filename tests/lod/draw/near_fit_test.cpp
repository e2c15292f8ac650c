#include "lod/draw/near_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lod::draw {
namespace {

constexpr base::Sphere kScene{glm::vec3(0.0F), 8.0F};

/// Looks along −z from within the scene, with a right angle from side to side and from top to bottom.
base::Camera cameraWithin(double ortho_height = 0.0) {
  base::ViewCamera view;
  view.position = {0.5, -0.25, 2.0};
  view.fov_y = glm::radians(90.0);
  view.width = view.height = 100;
  view.ortho_height = ortho_height;
  return base::cameraForScene(view, glm::dvec3(0.0), kScene);
}

glm::vec3 at(const base::Camera& camera, const glm::vec3& in_eye) {
  return glm::vec3(glm::inverse(camera.eye_from_scene) * glm::vec4(in_eye, 1.0F));
}

base::Aabb boxAround(const glm::vec3& center, float half) {
  return {center - half, center + half};
}

float depthOf(const base::Camera& camera, const glm::vec3& place) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(place, 1.0F);
  return clip.z / clip.w;
}

float nearOf(const base::Camera& camera) {
  return camera.clip_from_eye[3][2] / (camera.clip_from_eye[2][2] - 1.0F);
}

TEST(NearFit, nearGoesToTheNearestBoxAndFarStays) {
  const base::Camera camera = cameraWithin();
  NearFit fit(camera);
  EXPECT_TRUE(fit.add(boxAround(at(camera, {0.0F, 0.0F, -5.0F}), 1.0F)));
  EXPECT_TRUE(fit.add(boxAround(at(camera, {1.0F, 1.0F, -4.0F}), 1.0F)));
  const base::Camera fitted = fit.camera();
  EXPECT_NEAR(nearOf(fitted), 3.0F, 0.05F);
  EXPECT_LE(nearOf(fitted), 3.0F);
  const float far_plane = (glm::length(camera.eye) + kScene.radius) * 1.01F;
  EXPECT_LE(depthOf(fitted, at(camera, {0.0F, 0.0F, -far_plane})), 1.0F);
  EXPECT_GT(depthOf(fitted, at(camera, {0.0F, 0.0F, -far_plane})), 0.99F);
  EXPECT_EQ(fitted.clip_from_eye[0], camera.clip_from_eye[0]);
  EXPECT_EQ(fitted.clip_from_eye[1], camera.clip_from_eye[1]);
}

TEST(NearFit, boxesThatAreNotSeenDoNotCount) {
  const base::Camera camera = cameraWithin();
  NearFit fit(camera);
  EXPECT_TRUE(fit.add(boxAround(at(camera, {0.0F, 0.0F, -5.0F}), 1.0F)));
  EXPECT_TRUE(fit.add(boxAround(at(camera, {0.0F, 0.0F, 3.0F}), 1.0F))) << "behind the eye";
  EXPECT_TRUE(fit.add(boxAround(at(camera, {9.0F, 0.0F, -1.0F}), 1.0F))) << "beside the picture";
  EXPECT_NEAR(nearOf(fit.camera()), 4.0F, 0.05F);
}

TEST(NearFit, aBoxAroundTheEyeAsksForItsTriangles) {
  const base::Camera camera = cameraWithin();
  NearFit fit(camera);
  EXPECT_FALSE(fit.add(boxAround(camera.eye, 6.0F)));
  // The triangle passes below the eye and behind it. Its part in the picture begins 2 in front, at the lower rim.
  fit.addTriangle(at(camera, {-50.0F, -2.0F, 20.0F}), at(camera, {50.0F, -2.0F, 20.0F}),
                  at(camera, {0.0F, -2.0F, -40.0F}));
  EXPECT_NEAR(nearOf(fit.camera()), 2.0F, 0.1F);
  // One that the eye nearly touches leaves the near plane where it was.
  fit.addTriangle(at(camera, {-50.0F, -1e-6F, 20.0F}), at(camera, {50.0F, -1e-6F, 20.0F}),
                  at(camera, {0.0F, -1e-6F, -40.0F}));
  EXPECT_TRUE(fit.isKept());
  EXPECT_TRUE(base::sameCamera(fit.camera(), camera));
}

TEST(NearFit, withNothingToSeeAndInParallelViewsTheCameraStays) {
  EXPECT_TRUE(base::sameCamera(NearFit(cameraWithin()).camera(), cameraWithin()));
  NearFit parallel(cameraWithin(3.0));
  EXPECT_TRUE(parallel.add(boxAround(glm::vec3(0.0F), 1.0F)));
  EXPECT_TRUE(base::sameCamera(parallel.camera(), cameraWithin(3.0)));
}

TEST(NearFit, nothingThatIsSeenIsCutOff) {
  std::mt19937 random(5);
  const auto number = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random()) / static_cast<float>(std::mt19937::max());
  };
  int seen = 0;
  for (int round = 0; round < 200; ++round) {
    const base::Camera camera = cameraWithin();
    NearFit fit(camera);
    std::vector<base::Aabb> boxes;
    for (int i = 0; i < 3; ++i) {
      boxes.push_back(boxAround(at(camera, {number(-4, 4), number(-4, 4), number(-6, 1)}), number(0.01F, 1.0F)));
      if (!fit.add(boxes.back())) fit.keepNear();
    }
    const base::Sphere ball{at(camera, {number(-2, 2), number(-2, 2), number(-6, -1)}), number(0.01F, 0.9F)};
    if (!fit.add(ball)) fit.keepNear();
    const base::Camera fitted = fit.camera();
    std::vector<glm::vec3> places;
    for (const base::Aabb& box : boxes)
      for (int i = 0; i < 20; ++i)
        places.push_back(glm::mix(box.min, box.max, glm::vec3(number(0, 1), number(0, 1), number(0, 1))));
    places.push_back(ball.center + ball.radius * glm::normalize(camera.eye - ball.center));
    for (const glm::vec3& place : places) {
      const glm::vec4 before = camera.clipFromScene() * glm::vec4(place, 1.0F);
      if (glm::any(glm::greaterThan(glm::abs(glm::vec3(before)), glm::vec3(before.w)))) continue;
      ++seen;
      EXPECT_LT(std::abs(depthOf(fitted, place)), 1.0F);
    }
  }
  EXPECT_GT(seen, 2000);
}

}  // namespace
}  // namespace lod::draw
