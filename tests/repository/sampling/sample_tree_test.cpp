#include "repository/sampling/sample_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "tests/support/sample_points.h"

namespace {

using repository::Grid;
using repository::SampleTree;

Grid gridOf(const glm::uvec3& count) {
  Grid grid;
  grid.count = count;
  grid.face_size = 64;
  return grid;
}

std::set<std::uint64_t> codesOf(const std::vector<glm::uvec3>& points) {
  std::set<std::uint64_t> codes;
  for (const glm::uvec3& p : points) codes.insert(repository::FaceKey{p.x, p.y, p.z, 0}.code());
  return codes;
}

// The number of leaves that hold the grid's cells.
std::size_t leafCount(const SampleTree& tree, const Grid& grid) {
  std::set<std::uint64_t> leaves;
  for (std::uint32_t z = 0; z + 1 < grid.count.z; ++z)
    for (std::uint32_t y = 0; y + 1 < grid.count.y; ++y)
      for (std::uint32_t x = 0; x + 1 < grid.count.x; ++x) {
        const SampleTree::Cell leaf = tree.leafOf({x, y, z});
        EXPECT_TRUE(leaf.corner.x <= x && x < leaf.corner.x + leaf.size);
        leaves.insert(repository::FaceKey{leaf.corner.x, leaf.corner.y, leaf.corner.z, 0}.code());
      }
  return leaves.size();
}

// A tree in which some cells are split, some are closed, and some points are left out.
SampleTree randomTree(const Grid& grid, unsigned seed) {
  std::mt19937 random(seed);
  SampleTree tree(grid, 8);
  for (int round = 0; round < 3; ++round)
    for (const SampleTree::Cell& cell : tree.openLeaves()) {
      const auto choice = random() % 3;
      if (choice == 0) tree.split(cell);
      if (choice == 1) tree.close(cell);
    }
  const auto points = tree.points();
  for (const glm::uvec3& p : points)
    if (random() % 9 == 0) tree.leaveOut(p);
  return tree;
}

TEST(SampleTree, cellsOfOneStepSampleTheWholeGrid) {
  for (const glm::uvec3& count : {glm::uvec3(2), glm::uvec3(5, 9, 2), glm::uvec3(17, 6, 11)}) {
    const Grid grid = gridOf(count);
    const SampleTree tree(grid, 1);
    EXPECT_EQ(tree.points(), repository::pointsInMortonOrder(grid));
    EXPECT_EQ(leafCount(tree, grid), std::uint64_t{count.x - 1} * (count.y - 1) * (count.z - 1));
    EXPECT_TRUE(tree.openLeaves().empty());
  }
}

TEST(SampleTree, aCoarseTreeSamplesTheCornersOfItsCells) {
  const Grid grid = gridOf({9, 9, 6});
  const SampleTree tree(grid, 4);
  EXPECT_EQ(leafCount(tree, grid), 8U);
  EXPECT_EQ(tree.points().size(), 27U);  // x, y: 0 4 8; z: 0 4 and the grid's end, 5
  EXPECT_TRUE(support::hasPoint(tree, grid, {4, 8, 5}));
  EXPECT_FALSE(support::hasPoint(tree, grid, {4, 8, 3}));
  EXPECT_FALSE(support::hasPoint(tree, grid, {4, 2, 4}));
  EXPECT_EQ(tree.leafOf({7, 3, 4}), (SampleTree::Cell{{4, 0, 4}, 4}));
  EXPECT_EQ(tree.cornersOf({{4, 0, 4}, 4})[7], glm::uvec3(8, 4, 5));
}

TEST(SampleTree, splittingAddsTheCornersOfTheEight) {
  const Grid grid = gridOf({9, 9, 9});
  SampleTree tree(grid, 8);
  ASSERT_EQ(tree.openLeaves(), (std::vector<SampleTree::Cell>{{{0, 0, 0}, 8}}));
  tree.split({{0, 0, 0}, 8});
  EXPECT_EQ(tree.points().size(), 27U);
  tree.close({{4, 4, 4}, 4});
  tree.split({{0, 0, 0}, 4});
  EXPECT_EQ(tree.points().size(), 27U + 19U);
  EXPECT_EQ(leafCount(tree, grid), 7U + 8U);
  EXPECT_EQ(tree.openLeaves().size(), 6U + 8U);
  EXPECT_TRUE(support::hasPoint(tree, grid, {2, 4, 2}));  // on the side of a leaf that is twice as large
  EXPECT_FALSE(support::hasPoint(tree, grid, {6, 4, 2}));
  tree.leaveOut({2, 4, 2});
  EXPECT_FALSE(support::hasPoint(tree, grid, {2, 4, 2}));
  EXPECT_EQ(tree.points().size(), 45U);
}

TEST(SampleTree, hasPointAgreesWithPoints) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Grid grid = gridOf({17, 12, 9});
    const SampleTree tree = randomTree(grid, seed);
    const auto points = codesOf(tree.points());
    for (const glm::uvec3& p : repository::pointsInMortonOrder(grid))
      EXPECT_EQ(support::hasPoint(tree, grid, p), points.count(repository::FaceKey{p.x, p.y, p.z, 0}.code()) != 0);
  }
}

TEST(SampleTree, decodeInvertsEncode) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const Grid grid = gridOf({17, 12, 9});
    const SampleTree tree = randomTree(grid, seed);
    for (const auto form : {SampleTree::Form::kStored, SampleTree::Form::kPublished}) {
      const base::Bytes bytes = tree.encode(form);
      const auto back = SampleTree::decode(grid, bytes);
      ASSERT_TRUE(back) << back.error().message;
      EXPECT_EQ(back->encode(form), bytes);
      EXPECT_EQ(back->points(), tree.points());
      EXPECT_EQ(back->openLeaves(), tree.openLeaves());
    }
  }
}

TEST(SampleTree, encodeMatchesTheDocumentedExample) {
  SampleTree tree(gridOf({3, 3, 2}), 2);
  tree.split({{0, 0, 0}, 2});
  tree.leaveOut({1, 1, 0});
  const base::Bytes bytes = tree.encode();
  // The root is split into four open leaves of one step, since the grid ends there in z. One point is left out.
  const base::Bytes expected{0x54, 0x01, 2, 0, 0, 0, 1, 0, 0, 0, 0x02, 0x00, 0, 0xc0, 0, 0, 0, 0, 0, 0};
  ASSERT_EQ(bytes.size(), expected.size() + 4);
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), bytes.begin()));

  const base::Bytes published = tree.encode(SampleTree::Form::kPublished);
  const base::Bytes as_published{0x54, 0x02, 2, 0, 0, 0, 1, 0, 0, 0, 0x02, 0x00, 3};
  ASSERT_EQ(published.size(), as_published.size() + 4);
  EXPECT_TRUE(std::equal(as_published.begin(), as_published.end(), published.begin()));
}

TEST(SampleTree, damagedBytesAreRefused) {
  const Grid grid = gridOf({17, 12, 9});
  for (const auto form : {SampleTree::Form::kStored, SampleTree::Form::kPublished}) {
    const base::Bytes bytes = randomTree(grid, 3).encode(form);
    for (std::size_t length = 0; length < bytes.size(); ++length)
      EXPECT_FALSE(SampleTree::decode(grid, base::ByteView(bytes).first(length)));
    for (std::size_t i = 0; i < bytes.size(); ++i)
      for (const std::uint8_t flip : {0x01, 0x80}) {
        base::Bytes wrong = bytes;
        wrong[i] = static_cast<std::uint8_t>(wrong[i] ^ flip);
        EXPECT_FALSE(SampleTree::decode(grid, wrong)) << i;
      }
    EXPECT_FALSE(SampleTree::decode(gridOf({2, 2, 2}), bytes));
    EXPECT_FALSE(SampleTree::decode(Grid{}, bytes));
  }
}

}  // namespace
