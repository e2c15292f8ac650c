#include "repository/sampling/grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace repository {
namespace {

base::Aabb box(const glm::vec3& min, const glm::vec3& max) {
  base::Aabb result;
  result.add(min);
  result.add(max);
  return result;
}

glm::vec3 lastPoint(const Grid& grid) {
  return grid.point(grid.count.x - 1, grid.count.y - 1, grid.count.z - 1);
}

// A flat model of 8 × 4 × 1 gets 4 units on every side from margin 0.5, so its box is 16 × 12 × 9. 9 points along 16
// units are 2 apart.
TEST(Grid, theViewingBoxIsTwiceTheLongestSideWithTheSameMarginElsewhere) {
  const Grid grid = makeGrid(box(glm::vec3(0.0F), glm::vec3(8.0F, 4.0F, 1.0F)), 9, 0.5F, 512);
  EXPECT_FLOAT_EQ(grid.spacing, 2.0F);
  EXPECT_EQ(grid.count, glm::uvec3(9, 7, 6));  // 16 / 2, 12 / 2, ceil(9 / 2) steps
  EXPECT_EQ(grid.face_size, 512U);
  EXPECT_FLOAT_EQ(grid.first.x, -4.0F);
  EXPECT_FLOAT_EQ(lastPoint(grid).x, 12.0F);
  EXPECT_FLOAT_EQ(grid.first.y, -4.0F);
  EXPECT_FLOAT_EQ(lastPoint(grid).y, 8.0F);
  // The points cover 9 units by 10, centred on the model's 0.5.
  EXPECT_FLOAT_EQ(grid.first.z, -4.5F);
  EXPECT_FLOAT_EQ(lastPoint(grid).z, 5.5F);
}

TEST(Grid, pointsCoverTheWholeViewingBoxForManyShapes) {
  for (const glm::vec3& size :
       {glm::vec3(1.0F), glm::vec3(1.0F, 0.0F, 0.0F), glm::vec3(3.0F, 3.0F, 1e-3F), glm::vec3(0.1F, 0.3F, 0.7F)}) {
    for (const std::uint32_t points : {2U, 3U, 7U, 32U}) {
      for (const float margin : {0.0F, 0.1F, 0.5F}) {
        const glm::vec3 corner(-5.0F, 100.0F, 0.0F);
        const Grid grid = makeGrid(box(corner, corner + size), points, margin, 64);
        const float longest = std::max({size.x, size.y, size.z});
        const glm::vec3 slack(1e-4F * (longest + 100.0F));
        EXPECT_TRUE(glm::all(glm::lessThanEqual(grid.first, corner - glm::vec3(margin * longest) + slack)));
        EXPECT_TRUE(
            glm::all(glm::greaterThanEqual(lastPoint(grid), corner + size + glm::vec3(margin * longest) - slack)));
        EXPECT_EQ(std::max({grid.count.x, grid.count.y, grid.count.z}), points);
        EXPECT_GE(std::min({grid.count.x, grid.count.y, grid.count.z}), 2U);
      }
    }
  }
}

TEST(Grid, aModelOfOnePointStillHasABox) {
  const Grid grid = makeGrid(box(glm::vec3(3.0F), glm::vec3(3.0F)), 5, 0.5F, 64);
  EXPECT_GT(grid.spacing, 0.0F);
  EXPECT_EQ(grid.count, glm::uvec3(5));
}

TEST(Grid, cellOfAPointHoldsIt) {
  const Grid grid = makeGrid(box(glm::vec3(0.0F), glm::vec3(8.0F, 4.0F, 1.0F)), 9, 0.5F, 512);
  EXPECT_EQ(grid.cellOf(glm::vec3(-4.0F, -4.0F, -4.5F)), glm::uvec3(0));
  EXPECT_EQ(grid.cellOf(glm::vec3(1.0F, 1.0F, 0.0F)), glm::uvec3(2, 2, 2));
  EXPECT_EQ(grid.cellOf(glm::vec3(11.9F, 7.9F, 5.4F)), glm::uvec3(7, 5, 4));
}

TEST(Grid, cellOfIsClampedSoThatAllCornersExist) {
  const Grid grid = makeGrid(box(glm::vec3(0.0F), glm::vec3(8.0F, 4.0F, 1.0F)), 9, 0.5F, 512);
  const float huge = std::numeric_limits<float>::infinity();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const glm::vec3& p :
       {glm::vec3(-1e30F), glm::vec3(1e30F), glm::vec3(huge), glm::vec3(-huge), glm::vec3(nan), lastPoint(grid)}) {
    for (const glm::uvec3& corner : grid.cellCorners(p)) EXPECT_TRUE(glm::all(glm::lessThan(corner, grid.count)));
  }
  EXPECT_EQ(grid.cellOf(lastPoint(grid)), grid.count - glm::uvec3(2));
}

TEST(Grid, cellCornersAreTheEightDifferentOnes) {
  const Grid grid = makeGrid(box(glm::vec3(0.0F), glm::vec3(1.0F)), 4, 0.5F, 512);
  const glm::vec3 p(0.4F, 0.5F, 0.6F);
  auto corners = grid.cellCorners(p);
  std::sort(corners.begin(), corners.end(), [](const glm::uvec3& a, const glm::uvec3& b) {
    return FaceKey{a.x, a.y, a.z, 0} < FaceKey{b.x, b.y, b.z, 0};
  });
  EXPECT_EQ(std::unique(corners.begin(), corners.end()), corners.end());
  for (const glm::uvec3& c : corners) EXPECT_LE(glm::length(grid.point(c.x, c.y, c.z) - p), 1.7321F * grid.spacing);
}

TEST(Grid, mortonOrderVisitsEveryPointOnceInKeyOrder) {
  Grid grid;
  for (const glm::uvec3& count : {glm::uvec3(2, 2, 2), glm::uvec3(5, 3, 9), glm::uvec3(17, 2, 4)}) {
    grid.count = count;
    const auto points = pointsInMortonOrder(grid);
    ASSERT_EQ(points.size(), grid.pointCount());
    for (std::size_t i = 0; i < points.size(); ++i) {
      ASSERT_TRUE(glm::all(glm::lessThan(points[i], count)));
      if (i > 0) {
        ASSERT_LT((FaceKey{points[i - 1].x, points[i - 1].y, points[i - 1].z, 5}),
                  (FaceKey{points[i].x, points[i].y, points[i].z, 0}));
      }
    }
  }
}

TEST(Grid, encodeAndDecodeGiveTheSameGrid) {
  const Grid grid = makeGrid(box(glm::vec3(-3.0F), glm::vec3(8.0F, 4.0F, 1.0F)), 32, 0.5F, 512);
  for (const Grid& one : {grid, withTiles(grid, 3), Grid{}}) {
    base::ByteWriter out;
    one.encode(out);
    EXPECT_EQ(out.size(), 36U);
    base::ByteReader in(out.view());
    const auto back = Grid::decode(in);
    ASSERT_TRUE(back);
    EXPECT_EQ(*back, one);
    EXPECT_TRUE(in.atEnd());
  }
}

TEST(Grid, decodeRefusesEveryTruncation) {
  base::ByteWriter out;
  makeGrid(box(glm::vec3(0.0F), glm::vec3(1.0F)), 4, 0.5F, 64).encode(out);
  for (std::size_t size = 0; size < out.size(); ++size) {
    base::ByteReader in(base::ByteView(out.view()).first(size));
    EXPECT_FALSE(Grid::decode(in)) << size;
  }
}

TEST(Grid, decodeRefusesNumbersThatNoGridHas) {
  const Grid good = makeGrid(box(glm::vec3(0.0F), glm::vec3(1.0F)), 4, 0.5F, 64);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<Grid> bad(11, good);
  bad[0].first.y = nan;
  bad[1].first.x = std::numeric_limits<float>::infinity();
  bad[2].spacing = 0.0F;
  bad[3].spacing = -1.0F;
  bad[4].spacing = nan;
  bad[5].count.x = 1;
  bad[6].count.z = 0;
  bad[7].count.y = kMaxGridIndex + 2;
  bad[8].face_size = 0;
  bad[9].face_size = 16385;
  bad[10].spacing = 3e38F;  // the last point would be infinite
  for (std::size_t i = 0; i < bad.size(); ++i) {
    base::ByteWriter out;
    bad[i].encode(out);
    base::ByteReader in(out.view());
    EXPECT_FALSE(Grid::decode(in)) << i;
  }
}

}  // namespace
}  // namespace repository
