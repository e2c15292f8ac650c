#include <gtest/gtest.h>

#include "base/json/scene_file.h"

namespace {

const std::string kId = "0123456789abcdef0123456789abcdef";
const std::string kHash = kId + kId;

TEST(PartFile, publishedNamesHoldTheFirstHalfOfTheHash) {
  EXPECT_EQ(base::publishedName("patch.lgp", kHash), "patch-" + kId + ".lgp");
  EXPECT_EQ(base::publishedName("patch-ffffffffffffffffffffffffffffffff.lgp", kHash), "patch-" + kId + ".lgp");
  EXPECT_EQ(base::publishedName("a.b/plain", kHash), "a.b/plain-" + kId);
  EXPECT_TRUE(base::isPublishedName("patch-" + kId + ".lgp"));
  for (const std::string& other : {std::string("patch.lgp"), "patch-" + kId.substr(1) + ".lgp",
                                   "patch-" + kId.substr(1) + "G.lgp", kId + ".lgp", std::string()})
    EXPECT_FALSE(base::isPublishedName(other)) << other;
}

TEST(PartFile, partsAreFoundByStemAndExtensionUnderEitherName) {
  base::Scene scene;
  EXPECT_EQ(base::partFile(scene, "patch", ".lgp"), std::nullopt);
  EXPECT_EQ(base::patchPath("dir", scene), "dir/patch.lgp");
  scene.parts = {{"images", 0, ""}, {"../patch.lgp", 1, ""}, {"patch.lgp", 1, ""}};
  EXPECT_EQ(base::partFile(scene, "patch", ".lgp"), "patch.lgp");
  scene.parts = {
      {"patchy-" + kId + ".lgp", 1, ""}, {"patch-" + kId + ".lgp", 1, ""}, {"images/index-" + kId + ".lgi", 1, ""}};
  EXPECT_EQ(base::patchPath("dir", scene), "dir/patch-" + kId + ".lgp");
  EXPECT_EQ(base::partFile(scene, "images/index", ".lgi"), "images/index-" + kId + ".lgi");
  EXPECT_EQ(base::partFile(scene, "qsplat", ".lgq"), std::nullopt);
}

TEST(PartFile, streamedMethodsHaveAFileOfTheirName) {
  base::Scene scene;
  EXPECT_EQ(base::streamedPath("dir", scene, base::kSplatMethod), "dir/qsplat.lgq");
  scene.parts = {{"pmr-" + kId + ".lgm", 1, ""}};
  EXPECT_EQ(base::streamedPath("dir", scene, base::kUmbrellaMethod), "dir/pmr-" + kId + ".lgm");
}

TEST(PartFile, methodOfASceneWithoutPatchesIsTheFirstOfThoseItHas) {
  const auto methodOf = [](const std::vector<base::ScenePart>& parts) {
    base::Scene scene;
    scene.parts = parts;
    const base::StreamedMethod* method = base::methodWithoutPatches(scene);
    return std::string(method == nullptr ? "none" : method->name);
  };
  EXPECT_EQ(methodOf({}), "none");
  EXPECT_EQ(methodOf({{"pmr.lgm", 1, ""}}), "pmr");
  EXPECT_EQ(methodOf({{"hlod.lgh", 1, ""}}), "hlod");
  EXPECT_EQ(methodOf({{"pmr.lgm", 1, ""}, {"qsplat.lgq", 1, ""}}), "qsplat");
  EXPECT_EQ(methodOf({{"patch.lgp", 1, ""}, {"pmr.lgm", 1, ""}}), "none");
}

}  // namespace
