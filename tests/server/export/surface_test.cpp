#include "server/export/surface.h"

#include <gtest/gtest.h>

#include <cmath>

namespace {

using server::exports::floatOriginNear;

/// A hierarchy of one patch that is `size` units long.
lod::patch::Hierarchy lineOf(double size, double step) {
  lod::patch::Hierarchy h;
  h.lattice = {glm::dvec3(-0.5 * size), step};
  h.groups.resize(1);
  h.groups[0].patch_count = 1;
  h.patches.resize(1);
  h.patches[0].box.add(glm::vec3(static_cast<float>(-0.5 * size)));
  h.patches[0].box.add(glm::vec3(static_cast<float>(0.5 * size)));
  return h;
}

TEST(FloatOrigin, isOneForASceneOfFourMillionSteps) {
  const auto h = lineOf(4000.0, 0.001);
  const glm::ivec3 origin = floatOriginNear(h, glm::vec3(0.0F));
  for (const float x : {-1999.0F, -3.5F, 1234.0F, 1999.0F}) EXPECT_EQ(floatOriginNear(h, glm::vec3(x)), origin);
}

TEST(FloatOrigin, leavesFloatsLessThanHalfAStepOff) {
  const double step = 0.0007;
  const auto h = lineOf(100'000.0, step);
  for (const float x : {-50'000.0F, -12'345.6F, 0.0F, 2'222.2F, 50'000.0F}) {
    const int origin = floatOriginNear(h, glm::vec3(x)).x;
    // Half a tile of a million steps lies beyond the place.
    const double steps = std::round((static_cast<double>(x) - h.lattice.origin.x) / step) + 1e6 - origin;
    const auto written = static_cast<double>(static_cast<float>(step * steps));
    EXPECT_NEAR(written, step * steps, 0.5 * step) << x;
  }
}

TEST(MetresPerUnit, knowsBothFeet) {
  base::Scene scene;
  EXPECT_EQ(server::exports::metresPerUnit(scene), 1.0);
  scene.units = "ft";
  EXPECT_EQ(server::exports::metresPerUnit(scene), 0.3048);
  scene.units = "us-ft";
  EXPECT_NEAR(server::exports::metresPerUnit(scene), 0.304800609601219, 1e-15);
}

}  // namespace
