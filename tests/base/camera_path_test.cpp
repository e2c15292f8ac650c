#include "base/camera_path.h"

#include <gtest/gtest.h>

namespace {

base::ViewCamera at(double x) {
  base::ViewCamera view;
  view.position = {x, 0.0, 0.0};
  return view;
}

TEST(CameraPath, movesEvenlyOrJumps) {
  base::CameraPath path{{at(0.0), at(1.0), at(3.0)}, 2.0, false};
  EXPECT_EQ(path.seconds(), 1.5);
  EXPECT_DOUBLE_EQ(path.at(0.25).position.x, 0.5);
  EXPECT_DOUBLE_EQ(path.at(0.75).position.x, 2.0);
  EXPECT_EQ(path.at(-1.0).position.x, 0.0);
  EXPECT_EQ(path.at(9.0).position.x, 3.0);
  path.jumps = true;
  EXPECT_EQ(path.at(0.49).position.x, 0.0);
  EXPECT_EQ(path.at(0.5).position.x, 1.0);
}

TEST(CameraPath, restsWithoutRounding) {
  base::ViewCamera view = at(1.0 / 3.0);
  view.direction = glm::normalize(glm::dvec3(1.0, 2.0, 3.0));
  const base::CameraPath path{{view, view}, 10.0, false};
  for (int i = 0; i <= 60; ++i) EXPECT_EQ(path.at(i / 600.0), view) << i;
}

TEST(CameraPath, ofAHandHasEvenTimesAndKeepsRests) {
  const std::vector<base::SeenView> seen{{10.0, at(0.0)}, {10.05, at(1.0)}, {10.31, at(2.0)}, {10.5, at(2.0)}};
  const base::CameraPath path = base::pathOf(seen, 10.0);
  ASSERT_EQ(path.frames.size(), 6U);  // 10.0, 10.1 … 10.5
  const double expected[] = {0.0, 1.0, 1.0, 1.0, 2.0, 2.0};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(path.frames[i].position.x, expected[i]) << i;
  EXPECT_EQ(base::pathOf({{3.0, at(7.0)}}, 60.0).frames.size(), 1U);
  EXPECT_TRUE(base::pathOf({}, 60.0).frames.empty());
}

}  // namespace
