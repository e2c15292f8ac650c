#include "repository/sampling/cube_face.h"

#include <gtest/gtest.h>

#include <random>

namespace repository {
namespace {

Grid smallGrid() {
  base::Aabb model;
  model.add(glm::vec3(10.0F, 20.0F, 30.0F));
  model.add(glm::vec3(12.0F, 21.0F, 33.0F));
  return makeGrid(model, 5, 0.5F, 512);
}

// Counts the faces whose clip square, shrunk by `inset`, holds the direction, and returns the last of them too.
struct Hit {
  int faces = 0;
  std::uint32_t d = 6;
};
Hit facesThatSee(const Grid& grid, const glm::vec3& direction, float inset) {
  Hit hit;
  for (std::uint32_t d = 0; d < 6; ++d) {
    const base::Camera camera = faceCamera(grid, {1, 2, 3, d}, {grid.point(1, 2, 3), 100.0F});
    const glm::vec4 clip = camera.clipFromScene() * glm::vec4(camera.eye + direction, 1.0F);
    if (clip.w <= 0.0F || std::abs(clip.x) > clip.w * (1.0F - inset) || std::abs(clip.y) > clip.w * (1.0F - inset))
      continue;
    ++hit.faces;
    hit.d = d;
  }
  return hit;
}

TEST(CubeFace, everyDirectionProjectsIntoExactlyTheFaceThatIsNamed) {
  const Grid grid = smallGrid();
  std::mt19937 random(7);
  std::normal_distribution<float> normal;
  for (int i = 0; i < 5000; ++i) {
    const glm::vec3 direction = glm::normalize(glm::vec3(normal(random), normal(random), normal(random)));
    const Hit hit = facesThatSee(grid, direction, 1e-4F);
    if (hit.faces == 0) continue;  // within rounding of an edge of the cube
    ASSERT_EQ(hit.faces, 1);
    ASSERT_EQ(hit.d, faceOfDirection(direction));
  }
}

TEST(CubeFace, noDirectionFallsBetweenFaces) {
  const Grid grid = smallGrid();
  for (const float x : {-1.0F, 0.0F, 1.0F}) {
    for (const float y : {-1.0F, 0.0F, 1.0F}) {
      for (const float z : {-1.0F, 0.0F, 1.0F}) {
        if (x == 0.0F && y == 0.0F && z == 0.0F) continue;
        EXPECT_GE(facesThatSee(grid, glm::vec3(x, y, z), -1e-4F).faces, 1);
      }
    }
  }
}

TEST(CubeFace, directionsHaveThePapersOrder) {
  EXPECT_EQ(faceDirection(0), glm::vec3(1, 0, 0));
  EXPECT_EQ(faceDirection(1), glm::vec3(-1, 0, 0));
  EXPECT_EQ(faceDirection(2), glm::vec3(0, 1, 0));
  EXPECT_EQ(faceDirection(3), glm::vec3(0, -1, 0));
  EXPECT_EQ(faceDirection(4), glm::vec3(0, 0, 1));
  EXPECT_EQ(faceDirection(5), glm::vec3(0, 0, -1));
  for (std::uint32_t d = 0; d < 6; ++d) EXPECT_EQ(faceOfDirection(faceDirection(d)), d);
}

TEST(CubeFace, theCameraStandsAtThePointAndLooksAlongTheFace) {
  const Grid grid = smallGrid();
  for (std::uint32_t d = 0; d < 6; ++d) {
    const glm::vec3 eye = grid.point(4, 1, 2);
    const base::Camera camera = faceCamera(grid, {4, 1, 2, d}, {eye + 20.0F * faceDirection(d), 10.0F});
    EXPECT_EQ(camera.eye, grid.point(4, 1, 2));
    EXPECT_EQ(camera.width, 512);
    EXPECT_EQ(camera.height, 512);
    EXPECT_FLOAT_EQ(camera.pixelsPerUnitAtOne(), 256.0F);
    EXPECT_FLOAT_EQ(glm::determinant(glm::mat3(camera.eye_from_scene)), 1.0F);

    // These points lie at the centre of the picture, and at its top.
    const glm::vec4 center = camera.clipFromScene() * glm::vec4(camera.eye + 2.0F * faceDirection(d), 1.0F);
    EXPECT_NEAR(center.x, 0.0F, 1e-5F);
    EXPECT_NEAR(center.y, 0.0F, 1e-5F);
    EXPECT_FLOAT_EQ(center.w, 2.0F);
    const glm::vec4 top = camera.clipFromScene() * glm::vec4(camera.eye + faceDirection(d) + faceUp(d), 1.0F);
    EXPECT_NEAR(top.y / top.w, 1.0F, 1e-5F);
    // The nearest and the farthest point of the sphere are between the planes, also where they would be in a corner.
    for (const float distance : {10.0F, 30.0F}) {
      const glm::vec4 ahead = camera.clipFromScene() * glm::vec4(eye + distance * faceDirection(d), 1.0F);
      EXPECT_LT(std::abs(ahead.z), ahead.w);
      const glm::vec3 corner = glm::normalize(faceDirection(d) + faceUp(d) + glm::cross(faceDirection(d), faceUp(d)));
      const glm::vec4 aside = camera.clipFromScene() * glm::vec4(eye + distance * corner, 1.0F);
      EXPECT_LT(std::abs(aside.z), aside.w);
    }
  }
}

}  // namespace
}  // namespace repository
