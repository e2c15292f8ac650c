#include "server/net/open_scene.h"

#include <gtest/gtest.h>

#include "repository/parameters.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

TEST(OpenScene, welcomeIsFilledFromTheFiles) {
  const SceneDirectory directory;
  auto open = openScene(directory.path + "/");
  ASSERT_TRUE(open) << open.error().message;
  const protocol::Welcome& welcome = (*open)->data.welcome;
  EXPECT_EQ(welcome.scene_name, std::filesystem::path(directory.path).filename().string());
  EXPECT_EQ(welcome.group_count, (*open)->patches.hierarchy().groups.size());
  EXPECT_EQ(welcome.patch_count, (*open)->patches.hierarchy().patches.size());
  EXPECT_EQ(welcome.lattice_step, (*open)->patches.hierarchy().lattice.step);
  EXPECT_EQ(welcome.grid.count.x, 4U);
  EXPECT_NE((*open)->data.images, nullptr);
  EXPECT_FALSE(welcome.can_render_frames);
  EXPECT_TRUE(protocol::decodeServerMessage(protocol::encode(protocol::ServerMessage(welcome))));
}

TEST(OpenScene, missingFilesAreNamed) {
  const SceneDirectory directory(0);
  std::filesystem::remove(directory.path + "/patch.lgp");
  auto open = openScene(directory.path);
  ASSERT_FALSE(open);
  EXPECT_NE(open.error().message.find("patch.lgp"), std::string::npos);
  EXPECT_NE(openScene(directory.path + "/none").error().message.find("none"), std::string::npos);
}

TEST(OpenScene, gridsAreReadFromMetaOrRefused) {
  repository::Grid grid;
  grid.first = {-1.5F, 2.25F, 0.0F};
  grid.spacing = 0.125F;
  grid.count = {3, 4, 5};
  grid.face_size = 512;
  auto read = repository::gridFromMeta(metaOf(grid), "images");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(*read, grid);

  for (const char* meta : {"", "null", "[]", "{}", "not json", R"({"grid": {"first": [0,0,0]}})",
                           R"({"grid": {"first": [0,0], "spacing": 1, "count": [2,2,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,0], "spacing": "1", "count": [2,2,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,0], "spacing": 1, "count": [2,-2,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,0], "spacing": 1, "count": [2,2.5,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,0], "spacing": 0, "count": [2,2,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,1e99], "spacing": 1, "count": [2,2,2], "face_size": 64}})",
                           R"({"grid": {"first": [0,0,0], "spacing": 1, "count": [2,2,2], "face_size": 0}})"}) {
    auto refused = repository::gridFromMeta(meta, "images");
    ASSERT_FALSE(refused) << meta;
    EXPECT_NE(refused.error().message.find("images"), std::string::npos);
  }
}

}  // namespace
}  // namespace server
