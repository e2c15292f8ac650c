#include "server/session/motion.h"

#include <gtest/gtest.h>

#include <cmath>

namespace server {
namespace {

constexpr double kReach = 1.0;

base::ViewCamera cameraAt(double x, double turned = 0.0) {
  base::ViewCamera camera;
  camera.position = {x, 0.0, 5.0};
  camera.direction = {std::sin(turned), 0.0, -std::cos(turned)};
  return camera;
}

TEST(Motion, constantVelocityGoesOn) {
  Motion motion(kReach);
  for (int i = 0; i < 20; ++i) motion.accept(cameraAt(0.01 * i, 0.02 * i), 0.03 * i);
  const double newest = 0.03 * 19;
  ASSERT_TRUE(motion.moving(newest + 0.05));
  const base::ViewCamera ahead = motion.ahead(0.06);
  const base::ViewCamera expected = cameraAt(0.01 * 21, 0.02 * 21);
  EXPECT_NEAR(glm::length(ahead.position - expected.position), 0.0, 1e-9);
  EXPECT_NEAR(glm::length(ahead.direction - expected.direction), 0.0, 1e-9);
  EXPECT_NEAR(glm::length(ahead.up - expected.up), 0.0, 1e-9);
}

TEST(Motion, aheadIsLimitedInTimeAndLength) {
  Motion motion(kReach);
  motion.accept(cameraAt(0.0), 0.0);
  motion.accept(cameraAt(0.01), 0.01);
  EXPECT_NEAR(motion.ahead(100.0).position.x, 0.01 + Motion::kMaxAhead, 1e-9);
  motion.accept(cameraAt(0.9), 0.02);
  EXPECT_NEAR(motion.ahead(100.0).position.x, 0.9 + kReach, 1e-9);
}

TEST(Motion, jumpsPausesOtherSizesAndSectionsBeginAnew) {
  Motion motion(kReach);
  EXPECT_FALSE(motion.accept(cameraAt(0.0), 0.0));
  EXPECT_TRUE(motion.accept(cameraAt(0.1), 0.03));
  EXPECT_FALSE(motion.accept(cameraAt(5.0), 0.06)) << "too far";
  EXPECT_FALSE(motion.moving(0.06));
  EXPECT_FALSE(motion.accept(cameraAt(5.0, 2.0), 0.09)) << "turned away";
  EXPECT_FALSE(motion.accept(cameraAt(5.0, 2.0), 2.0)) << "later";
  base::ViewCamera larger = cameraAt(5.0, 2.0);
  larger.width = 1920;
  EXPECT_FALSE(motion.accept(larger, 2.03));
  base::ViewCamera cut = larger;
  cut.section = base::SectionPlane{};
  EXPECT_FALSE(motion.accept(cut, 2.06)) << "it shows something else";
}

TEST(Motion, endsWhenNoViewFollowsOrNothingChanges) {
  Motion motion(kReach);
  motion.accept(cameraAt(0.0), 0.0);
  motion.accept(cameraAt(0.1), 0.03);
  EXPECT_TRUE(motion.moving(0.04));
  EXPECT_FALSE(motion.moving(motion.settledAt()));
  motion.accept(cameraAt(0.1), 0.06);
  for (int i = 3; i < 10; ++i) motion.accept(cameraAt(0.1), 0.03 * i);
  EXPECT_FALSE(motion.moving(0.27)) << "the views are alike";
}

TEST(Motion, viewsAtOneInstantTellNoSpeed) {
  Motion motion(kReach);
  motion.accept(cameraAt(0.0), 0.0);
  motion.accept(cameraAt(0.1), 0.0);
  EXPECT_FALSE(motion.moving(0.0));
}

}  // namespace
}  // namespace server
