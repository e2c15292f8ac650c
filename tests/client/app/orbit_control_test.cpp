#include "client/app/orbit_control.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <utility>
#include <vector>

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

/// A scene of this box, with z up.
protocol::Welcome sceneOf(const glm::dvec3& box_min, const glm::dvec3& box_max) {
  protocol::Welcome scene;
  scene.origin = box_min;
  scene.box_max = glm::vec3(box_max - box_min);
  return scene;
}

/// The share of half the picture from its middle to each side that the points fill: left, right, above, below.
std::array<double, 4> filled(const base::ViewCamera& camera, const std::vector<glm::dvec3>& points) {
  std::array<double, 4> share{-1e9, -1e9, -1e9, -1e9};
  for (const glm::dvec3& point : points) {
    EXPECT_GT(glm::dot(point - camera.position, camera.direction), 0.0);
    const glm::dvec2 at = 2.0 * shownAt(camera, point) / glm::dvec2(camera.width, camera.height) - 1.0;
    share = {std::max(share[0], -at.x), std::max(share[1], at.x), std::max(share[2], -at.y), std::max(share[3], at.y)};
  }
  return share;
}

/// Nothing is beyond nine tenths of the way to a side, on the tighter axis both outermost points lie there, and on the
/// other one they are equally far from the middle.
void expectNineTenths(const std::array<double, 4>& share) {
  for (const double one : share) EXPECT_LT(one, 0.9 + 1e-4);
  EXPECT_NEAR(share[0], share[1], 0.004);
  EXPECT_NEAR(share[2], share[3], 0.004);
  const bool is_wide = std::max(share[0], share[1]) > std::max(share[2], share[3]);
  EXPECT_NEAR(share[is_wide ? 0 : 2], 0.9, 1e-4);
  EXPECT_NEAR(share[is_wide ? 1 : 3], 0.9, 1e-4);
}

class Orbit : public ::testing::Test {
 protected:
  void SetUp() override {
    control.setViewport(800, 600);
    control.frameScene(sceneOf(kMin, kMax));
  }
  double pivotDistance() const { return glm::length(control.camera().position - control.pivot()); }
  glm::dvec2 shown(const glm::dvec3& point) const { return shownAt(control.camera(), point); }
  static std::vector<glm::dvec3> corners() {
    std::vector<glm::dvec3> all;
    for (int corner = 0; corner < 8; ++corner)
      all.emplace_back((corner & 1) != 0 ? kMax.x : kMin.x, (corner & 2) != 0 ? kMax.y : kMin.y,
                       (corner & 4) != 0 ? kMax.z : kMin.z);
    return all;
  }
  OrbitControl control;
};

TEST_F(Orbit, theFirstViewShowsTheWholeBox) {
  expectNineTenths(filled(control.camera(), corners()));
}

TEST_F(Orbit, theFirstViewLooksWhereItIsTold) {
  for (const glm::vec3& direction : {glm::vec3(1.0, 0.0, 0.0), glm::vec3(-0.3, 0.8, -0.5), glm::vec3(0.1, 0.1, -2)}) {
    protocol::Welcome scene = sceneOf(kMin, kMax);
    scene.start_direction = direction;
    control.frameScene(scene);
    EXPECT_GT(glm::dot(control.camera().direction, glm::dvec3(glm::normalize(direction))), 0.999);
    expectNineTenths(filled(control.camera(), corners()));
  }
}

TEST_F(Orbit, aNarrowWindowShowsTheWholeBoxToo) {
  control.setViewport(200, 900);
  control.setViewpoint(control.framingViewpoint());
  expectNineTenths(filled(control.camera(), corners()));
}

/// A slanted stick from the box's lower left to its middle.
class OrbitHull : public Orbit {
 protected:
  void frame(const std::vector<glm::vec3>& points) {
    protocol::Welcome scene = sceneOf(kMin, kMax);
    scene.hull = points;
    control.frameScene(scene);
    hull.clear();
    for (const glm::vec3& p : points) hull.push_back(kMin + glm::dvec3(p));
  }
  const std::vector<glm::vec3> stick{{0, 0, 0}, {1, 0, 0}, {0, 0, 1}, {5, 10, 2}, {5, 9, 3}};
  std::vector<glm::dvec3> hull;
};

TEST_F(OrbitHull, fillsThePictureOfAnyShapeFromAnyDirection) {
  for (const auto& [width, height] : {std::pair(800, 600), std::pair(200, 900), std::pair(1600, 300)}) {
    control.setViewport(width, height);
    frame(stick);
    const base::ViewCamera first = control.camera();
    expectNineTenths(filled(first, hull));
    EXPECT_EQ(control.firstViewpoint().position, first.position);
    for (int turn = 0; turn < 7; ++turn) {
      control.orbit(90.0, 25.0);
      control.setViewpoint(control.framingViewpoint());
      expectNineTenths(filled(control.camera(), hull));
    }
  }
}

TEST_F(OrbitHull, fillsAnOrthographicPictureToo) {
  control.setOrthographic(true);
  for (const auto& [width, height] : {std::pair(800, 600), std::pair(200, 900)}) {
    control.setViewport(width, height);
    frame(stick);
    const double pixel = control.orthoHeight() / height;
    std::array<double, 4> share{-1e9, -1e9, -1e9, -1e9};
    for (const glm::dvec3& point : hull) {
      const glm::dvec3 at = point - control.camera().position;
      const double x = glm::dot(at, control.right()) / (0.5 * width * pixel);
      const double y = glm::dot(at, control.upInView()) / (0.5 * height * pixel);
      share = {std::max(share[0], -x), std::max(share[1], x), std::max(share[2], y), std::max(share[3], -y)};
    }
    expectNineTenths(share);
  }
}

TEST_F(OrbitHull, theViewTurnsAboutItsMidst) {
  frame(stick);
  double near = 1e9;
  double far = -1e9;
  for (const glm::dvec3& point : hull) {
    const double depth = glm::dot(point - control.pivot(), control.camera().direction);
    near = std::min(near, depth), far = std::max(far, depth);
  }
  EXPECT_LT(near, 0.0);
  EXPECT_NEAR(near, -far, 1e-6);
  expectNear(shown(control.pivot()), {400.0, 300.0}, 1e-4);
}

TEST_F(OrbitHull, ofAPointOrALineAheadIsLookedAt) {
  frame({{3, 4, 1}});
  expectNear(shown(hull[0]), {400.0, 300.0}, 1e-4);
  EXPECT_NEAR(pivotDistance(), 1e-3 * glm::length(kMax - kMin), 1e-6);

  // Where the picture is filled by nothing, the eye is still ahead of all of it.
  const glm::dvec3 ahead = control.camera().direction;
  frame({{3, 4, 1}, glm::vec3(3, 4, 1) + 2.0F * glm::vec3(ahead)});
  for (const glm::dvec3& point : hull) EXPECT_GT(glm::dot(point - control.camera().position, ahead), -1e-5);
  EXPECT_NEAR(glm::length(control.pivot() - 0.5 * (hull[0] + hull[1])), 0.0, 1e-5);
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
    protocol::Welcome scene = sceneOf(glm::dvec3(-1.0), glm::dvec3(1.0));
    scene.up = glm::vec3(up);
    control.frameScene(scene);
    control.orbit(13.0, 7.0);
    EXPECT_TRUE(std::isfinite(control.camera().position.x));
    EXPECT_GT(glm::dot(control.camera().up, up), 0.0);
    EXPECT_LT(glm::dot(control.camera().direction, glm::normalize(up)), 0.0) << "looks down a little";
  }
}

}  // namespace
}  // namespace client
