#pragma once
// A fixture that bakes a sphere of two levels, which lies between -1 and 1.
#include <gtest/gtest.h>

#include <functional>

#include "server/bake/bake.h"
#include "tests/server/bake/sphere.h"

namespace server::test {

class SphereBake : public testing::Test {
 protected:
  /// `points`: of the grid, along a side.
  explicit SphereBake(std::uint32_t points)
      : scene_(sphere(6, -1.0F, 1.0F), {sphere(8, -1.0F, 0.0F), sphere(8, 0.0F, 1.0F)}, 0.1F) {
    scene_.scene().box_min = glm::dvec3(-1.0);
    scene_.scene().box_max = glm::dvec3(1.0);
    scene_.scene().parts = {{"patch.lgp", 1, "abc"}};
    options_.grid = repository::makeGrid(scene_.scene().localBox(), points, 0.5F, 64);
  }
  base::Result<BakeSummary> run(
      repository::Store& store,
      const std::function<bool(const BakeProgress&)>& progress = [](const BakeProgress&) { return true; }) {
    return bake(scene_.scene(), scene_.file(), store, options_, progress);
  }

  TwoLevelScene scene_;
  BakeOptions options_;
};

}  // namespace server::test
