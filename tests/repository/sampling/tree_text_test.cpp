#include "repository/sampling/tree_text.h"

#include <gtest/gtest.h>

#include "repository/sampling/parameters.h"

namespace repository {
namespace {

const std::string kParameters = "{\n\"version\": 1,\n\"quality\": 85,\n\"patch.lgp\": \"abc\"\n}\n";

Grid testGrid() {
  Grid grid;
  grid.count = {9, 5, 9};
  grid.face_size = 64;
  return grid;
}

TEST(TreeText, treeAndGrowthComeBackAndTheParametersStay) {
  SampleTree tree(testGrid(), 4);
  tree.split({{0, 0, 4}, 4});
  tree.leaveOut({4, 4, 4});
  const std::vector<TreeGrowth> growth{{8, 1, 8, 1234567890123, 20.25, 11.5, 1}, {4, 8, 27, 99, 99.0, 31.0, 0}};
  const std::string text = withTree(kParameters, tree, growth);
  EXPECT_EQ(withoutTree(text), kParameters);
  const auto back = treeFromText(text, testGrid(), "images");
  ASSERT_TRUE(back && *back);
  EXPECT_EQ((*back)->encode(), tree.encode());
  const auto rows = growthFromText(text);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[0].cell, 8U);
  EXPECT_EQ(rows[0].bytes, 1234567890123U);
  EXPECT_EQ(rows[0].psnr_db, 20.25);
  EXPECT_EQ(rows[1].worst_psnr_db, 31.0);
  EXPECT_EQ(rows[1].points, 27U);
  EXPECT_EQ(withTree(withoutTree(text), **back, rows), text);
}

TEST(TreeText, aTextWithoutATreeSamplesTheWholeGrid) {
  const auto none = treeFromText(kParameters, testGrid(), "images");
  ASSERT_TRUE(none);
  EXPECT_FALSE(*none);
  EXPECT_EQ(withoutTree(kParameters), kParameters);
  EXPECT_TRUE(growthFromText(kParameters).empty());
  EXPECT_TRUE(growthFromText(withTree(kParameters, SampleTree(testGrid(), 4), {})).empty());
}

TEST(TreeText, aDamagedTreeIsAnErrorThatNamesTheStore) {
  const std::string text = withTree(kParameters, SampleTree(testGrid(), 4), {});
  const std::size_t at = text.find("\"tree\": \"") + 9;
  for (const std::string& wrong :
       {text.substr(0, at) + "zz" + text.substr(at + 2), text.substr(0, at) + text.substr(at + 1),
        text.substr(0, at + 9), text.substr(0, at) + "00" + text.substr(at + 2)}) {
    const auto tree = treeFromText(wrong, testGrid(), "scene/images");
    ASSERT_FALSE(tree) << wrong;
    EXPECT_EQ(tree.error().message.rfind("scene/images: the tree of sampling points", 0), 0U) << tree.error().message;
    EXPECT_NE(tree.error().message.find("--force"), std::string::npos);
  }
}

TEST(Parameters, areComparedWithoutTrees) {
  const std::string one = withTree(kParameters, SampleTree(testGrid(), 4), {});
  const std::string two = withTree(kParameters, SampleTree(testGrid(), 2), {{8, 1, 8, 5, 20.0, 11.5, 1}});
  EXPECT_TRUE(sameParameters(one, two));
  EXPECT_TRUE(sameParameters(one, kParameters));
  std::string other = kParameters;
  other.replace(other.find("85"), 2, "90");
  EXPECT_FALSE(sameParameters(one, other));
  EXPECT_EQ(firstDifference(one, other), "\"quality\": 85, now \"quality\": 90");
  std::string more = kParameters;
  more.insert(more.rfind("\n}"), ",\n\"target\": 30");
  EXPECT_EQ(firstDifference(one, more), "nothing said of \"target\": 30");
  EXPECT_EQ(firstDifference(more, one), "\"target\": 30, now nothing said of it");
}

}  // namespace
}  // namespace repository
