#include "repository/sampling/parameters.h"

#include <gtest/gtest.h>

namespace repository {
namespace {

const std::string kParameters = "{\n\"version\": 1,\n\"quality\": 85,\n\"patch.lgp\": \"abc\"\n}\n";

Grid testGrid() {
  Grid grid;
  grid.count = {9, 5, 9};
  grid.face_size = 64;
  return grid;
}

TEST(TreeText, aTreeComesBackAndTheParametersStay) {
  SampleTree tree(testGrid(), 4);
  tree.split({{0, 0, 4}, 4});
  tree.leaveOut({4, 4, 4});
  const std::string text = withTree(kParameters, tree);
  EXPECT_EQ(withoutSelection(text), kParameters);
  const auto back = treeFromText(text, testGrid(), "images");
  ASSERT_TRUE(back && *back);
  EXPECT_EQ((*back)->encode(), tree.encode());
  EXPECT_EQ(withTree(withoutSelection(text), **back), text);
}

TEST(TreeText, aTextWithoutATreeSamplesTheWholeGrid) {
  const auto none = treeFromText(kParameters, testGrid(), "images");
  ASSERT_TRUE(none);
  EXPECT_FALSE(*none);
  EXPECT_EQ(withoutSelection(kParameters), kParameters);
}

TEST(TreeText, aDamagedTreeIsAnErrorThatNamesTheStore) {
  const std::string text = withTree(kParameters, SampleTree(testGrid(), 4));
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

TEST(Parameters, theFirstLineThatDiffersIsToldAndTreesWithoutTheirBytes) {
  const std::string one = withTree(kParameters, SampleTree(testGrid(), 4));
  const std::string two = withTree(kParameters, SampleTree(testGrid(), 2));
  EXPECT_EQ(firstDifference(one, two), "other sampling points");
  EXPECT_EQ(firstDifference(one, kParameters), "other sampling points");
  std::string other = kParameters;
  other.replace(other.find("85"), 2, "90");
  EXPECT_EQ(firstDifference(one, other), "\"quality\": 85, now \"quality\": 90");
  std::string more = kParameters;
  more.insert(more.rfind("\n}"), ",\n\"demand views\": 30");
  EXPECT_EQ(firstDifference(one, more), "nothing said of \"demand views\": 30");
  EXPECT_EQ(firstDifference(more, one), "\"demand views\": 30, now nothing said of it");
}

}  // namespace
}  // namespace repository
