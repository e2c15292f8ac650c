#include "client/app/orbit_control.h"

#include <gtest/gtest.h>

#include <cmath>

namespace client {
namespace {

/// Projects a world point to pixels from the upper left corner; written independently of the code under test.
glm::dvec2 shownAt(const base::ViewCamera& camera, const glm::dvec3& point) {
  const glm::dmat4 eye_from_world = glm::lookAt(camera.position, camera.position + camera.direction, camera.up);
  const glm::dmat4 clip_from_eye =
      glm::perspective(camera.fov_y, static_cast<double>(camera.width) / camera.height, 0.01, 1000.0);
  const glm::dvec4 clip = clip_from_eye * eye_from_world * glm::dvec4(point, 1.0);
  return {0.5 * camera.width * (1.0 + clip.x / clip.w), 0.5 * camera.height * (1.0 - clip.y / clip.w)};
}

void expectNear(const glm::dvec2& a, const glm::dvec2& b, double tolerance = 1e-6) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
}

/// Uses survey coordinates; whatever works there works near the origin, too.
const glm::dvec3 kMin{500'000.0, 4'000'000.0, 100.0};
const glm::dvec3 kMax{500'010.0, 4'000'020.0, 105.0};
const glm::dvec3 kSurface{500'004.0, 4'000'007.0, 103.0};

class Orbit : public ::testing::Test {
 protected:
  void SetUp() override {
    control.setViewport(800, 600);
    control.frameBox(kMin, kMax, {0.0, 0.0, 1.0});
  }
  double pivotDistance() const { return glm::length(control.camera().position - control.pivot()); }
  glm::dvec2 shown(const glm::dvec3& point) const { return shownAt(control.camera(), point); }
  // All corners of the box are in the picture, its centre is in the middle, and the outermost corner lies at nine
  // tenths of the way to a side.
  void expectFramed(double width, double height) const {
    glm::dvec2 low(1e9), high(-1e9);
    for (int corner = 0; corner < 8; ++corner) {
      const glm::dvec2 at = shown({(corner & 1) != 0 ? kMax.x : kMin.x, (corner & 2) != 0 ? kMax.y : kMin.y,
                                   (corner & 4) != 0 ? kMax.z : kMin.z});
      low = glm::min(low, at), high = glm::max(high, at);
    }
    EXPECT_TRUE(low.x >= 0.0 && low.y >= 0.0 && high.x <= width && high.y <= height);
    const glm::dvec2 middle(0.5 * width, 0.5 * height);
    const glm::dvec2 outermost = glm::max(middle - low, high - middle) / middle;
    EXPECT_NEAR(std::max(outermost.x, outermost.y), 0.9, 1e-3);
    expectNear(shown(0.5 * (kMin + kMax)), middle, 1e-4);
  }
  OrbitControl control;
};

TEST_F(Orbit, theFirstViewShowsTheWholeBox) {
  expectFramed(800.0, 600.0);
}

TEST_F(Orbit, theFirstViewLooksWhereItIsTold) {
  for (const glm::dvec3& direction :
       {glm::dvec3(1.0, 0.0, 0.0), glm::dvec3(-0.3, 0.8, -0.5), glm::dvec3(0.1, 0.1, -2)}) {
    control.frameBox(kMin, kMax, {0.0, 0.0, 1.0}, direction);
    EXPECT_GT(glm::dot(control.camera().direction, glm::normalize(direction)), 0.999);
    expectFramed(800.0, 600.0);
  }
}

TEST_F(Orbit, aNarrowWindowShowsTheWholeBoxToo) {
  control.setViewport(200, 900);
  control.frameBox(kMin, kMax, {0.0, 0.0, 1.0});
  expectFramed(200.0, 900.0);
}

TEST_F(Orbit, orbitingKeepsTheDistanceToThePivotAndItsPlaceOnTheScreen) {
  control.setViewpoint(control.viewpointCentredOn(kSurface));
  const double distance = pivotDistance();
  const glm::dvec2 place = shown(kSurface);
  for (const glm::dvec2& drag : {glm::dvec2(100.0, 0.0), glm::dvec2(-37.0, 55.0), glm::dvec2(3.0, -80.0)}) {
    control.orbit(drag.x, drag.y);
    EXPECT_NEAR(pivotDistance(), distance, 1e-6);
    expectNear(shown(kSurface), place, 1e-4);
    EXPECT_NEAR(glm::length(control.camera().direction), 1.0, 1e-12);
  }
}

TEST_F(Orbit, draggingRightTurnsTheNearSideRight) {
  const glm::dvec3 near_side = control.pivot() - 2.0 * control.camera().direction;
  const double before = shown(near_side).x;
  control.orbit(20.0, 0.0);
  EXPECT_GT(shown(near_side).x, before);
}

TEST_F(Orbit, draggingDownTurnsTheNearSideDown) {
  const glm::dvec3 near_side = control.pivot() - 2.0 * control.camera().direction;
  const double before = shown(near_side).y;
  control.orbit(0.0, 20.0);
  EXPECT_GT(shown(near_side).y, before);
}

TEST_F(Orbit, orbitingNeverTipsOverThePoles) {
  for (const double dy : {37.0, -41.0}) {
    for (int i = 0; i < 100; ++i) {
      control.orbit(5.0, dy);
      const double along_up = control.camera().direction.z;
      EXPECT_LT(std::abs(along_up), 1.0 - 1e-6);
      EXPECT_TRUE(std::isfinite(control.camera().position.x));
    }
    EXPECT_GT(std::abs(control.camera().direction.z), 0.999) << "but comes near them";
  }
}

TEST_F(Orbit, zoomingKeepsTheSurfacePointUnderTheCursorAndComesNearer) {
  const glm::dvec2 cursor = shown(kSurface);
  const double before = glm::length(kSurface - control.camera().position);
  control.zoom(3.0, cursor.x, cursor.y, kSurface);
  expectNear(shown(kSurface), cursor, 1e-4);
  EXPECT_NEAR(glm::length(kSurface - control.camera().position), before * 0.8 * 0.8 * 0.8, 1e-6);

  control.zoom(-3.0, cursor.x, cursor.y, kSurface);
  EXPECT_NEAR(glm::length(kSurface - control.camera().position), before, 1e-6);
}

TEST_F(Orbit, zoomingOverBackgroundGoesTowardsTheCursorAtThePivotsDepth) {
  const double depth = glm::dot(control.pivot() - control.camera().position, control.camera().direction);
  control.zoom(1.0, 700.0, 100.0, std::nullopt);
  const double after = glm::dot(control.pivot() - control.camera().position, control.camera().direction);
  EXPECT_NEAR(after, 0.8 * depth, 1e-6);
}

TEST_F(Orbit, zoomingNeverReachesTheSurfaceNorTheEndOfTheWorld) {
  const glm::dvec2 cursor = shown(kSurface);
  control.zoom(1000.0, cursor.x, cursor.y, kSurface);
  EXPECT_GT(glm::length(kSurface - control.camera().position), 0.0);
  EXPECT_LT(glm::length(kSurface - control.camera().position), 1e-3);
  control.zoom(-1000.0, cursor.x, cursor.y, kSurface);
  EXPECT_LT(glm::length(kSurface - control.camera().position), 1e4);
}

TEST_F(Orbit, theGrabbedPointMovesWithTheCursor) {
  const glm::dvec2 cursor = shown(kSurface);
  control.grab(cursor.x, cursor.y, kSurface);
  const glm::dvec3 direction = control.camera().direction;
  for (const glm::dvec2& to : {glm::dvec2(500.0, 200.0), glm::dvec2(20.0, 580.0), cursor}) {
    control.dragTo(to.x, to.y);
    expectNear(shown(kSurface), to, 1e-4);
    EXPECT_EQ(control.camera().direction, direction) << "panning does not turn";
  }
}

TEST_F(Orbit, panningTakesThePivotAlong) {
  const double distance = pivotDistance();
  control.grab(400.0, 300.0, kSurface);
  control.dragTo(100.0, 50.0);
  EXPECT_NEAR(pivotDistance(), distance, 1e-6);
}

TEST_F(Orbit, theFirstViewpointGoesBackAndKeepsTheWindowsSize) {
  const base::ViewCamera first = control.camera();
  const glm::dvec3 pivot = control.pivot();
  control.orbit(50.0, 20.0);
  control.zoom(5.0, 10.0, 10.0, std::nullopt);
  control.setViewport(1024, 768);
  control.setViewpoint(control.firstViewpoint());
  EXPECT_EQ(control.camera().position, first.position);
  EXPECT_EQ(control.camera().direction, first.direction);
  EXPECT_EQ(control.pivot(), pivot);
  EXPECT_EQ(control.camera().width, 1024);
}

TEST_F(Orbit, flyingForwardGoesWhereTheViewLooks) {
  const glm::dvec3 from = control.camera().position;
  const double distance = pivotDistance();
  control.fly({0.0, 0.0, 0.5});
  const glm::dvec3 moved = control.camera().position - from;
  EXPECT_NEAR(glm::dot(moved, control.camera().direction), 0.5 * distance, 1e-6);
  EXPECT_NEAR(glm::length(moved), 0.5 * distance, 1e-6);
}

TEST(OrbitControl, anyUpVectorWillDo) {
  for (const glm::dvec3& up :
       {glm::dvec3(1.0, 0.0, 0.0), glm::dvec3(0.0, 1.0, 0.0), glm::dvec3(0.0, 0.0, -2.0), glm::dvec3(1.0, 1.0, 1.0)}) {
    OrbitControl control;
    control.frameBox({-1.0, -1.0, -1.0}, {1.0, 1.0, 1.0}, up);
    control.orbit(13.0, 7.0);
    EXPECT_TRUE(std::isfinite(control.camera().position.x));
    EXPECT_GT(glm::dot(control.camera().up, up), 0.0);
    EXPECT_LT(glm::dot(control.camera().direction, glm::normalize(up)), 0.0) << "looks down a little";
  }
}

}  // namespace
}  // namespace client
