#include "server/scene/open_scene.h"

#include <gtest/gtest.h>

#include "repository/packs/publish.h"
#include "repository/sampling/parameters.h"
#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/temporary_directory.h"

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
  EXPECT_EQ(welcome.units, "m");
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

TEST(OpenScene, publishedSceneIsRecognised) {
  const SceneDirectory directory;
  auto built = openScene(directory.path);
  ASSERT_TRUE(built) << built.error().message;
  EXPECT_EQ((*built)->packs, nullptr);
  const std::string out = directory.path + "/out";
  base::Scene scene = (*built)->scene;
  {
    auto sink = repository::openDirectorySink(out);
    const auto images = repository::publishImages(*(*built)->images, **sink, {});
    ASSERT_TRUE(images) << images.error().message;
    const std::string hash = *base::sha256OfFile(directory.path + "/patch.lgp");
    const std::string patches = base::publishedName("patch.lgp", hash);
    ASSERT_TRUE((*sink)->putFile(patches, directory.path + "/patch.lgp", ""));
    scene.parts = {{patches, std::filesystem::file_size(out + "/" + patches), hash},
                   {images->index, images->index_bytes, images->index_sha256}};
  }
  ASSERT_TRUE(base::writeSceneFile(scene, out + "/scene.json"));

  auto open = openScene(out);
  ASSERT_TRUE(open) << open.error().message;
  ASSERT_NE((*open)->packs, nullptr);
  EXPECT_EQ((*open)->images.get(), (*open)->packs);
  EXPECT_EQ((*open)->data.welcome.grid, (*built)->data.welcome.grid);
  EXPECT_EQ(*(*open)->images->size(), *(*built)->images->size());
  EXPECT_EQ(*(*open)->images->get({1, 1, 1, 3}), *(*built)->images->get({1, 1, 1, 3}));

  // Its server also answers to the name that scene.json gives.
  const RunningServer server(out);
  const auto answer = httpRequest(server.port(), "/" + scene.parts[0].file, {{"Range", "bytes=0-7"}});
  EXPECT_EQ(answer.status, 206);
  EXPECT_EQ(answer.body, "LGPATCH\n");
  EXPECT_EQ(httpRequest(server.port(), "/" + scene.parts[1].file).status, 404);

  std::filesystem::remove(out + "/" + scene.parts[1].file);
  const auto lost = openScene(out);
  ASSERT_FALSE(lost);
  EXPECT_NE(lost.error().message.find(scene.parts[1].file), std::string::npos) << lost.error().message;
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

// A copy without textures could only draw frames that are less exact than the images beside them.
TEST(OpenScene, aCopyWithoutTexturesSaysSo) {
  const support::TemporaryDirectory folder;
  const auto done = [](const std::vector<std::string>& arguments) {
    const programs::Outcome outcome = programs::run("lumigrid", arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
  };
  done({"sample", "--shape", "facade", "--triangles", "500", "--texels", "50", "-o", folder / "facade.obj"});
  done({"build", folder / "facade.obj", "-o", folder / "scene", "--methods", "patch", "--quiet"});
  done({"publish", folder / "scene", folder / "copy", "--quiet", "--viewer", "off"});
  done({"publish", folder / "scene", folder / "whole", "--quiet", "--viewer", "off", "--with-textures"});
  for (const auto& [name, lacks] : {std::pair("scene", false), {"copy", true}, {"whole", false}}) {
    const auto open = openScene(folder / name);
    ASSERT_TRUE(open) << open.error().message;
    EXPECT_EQ(lacksTextures(**open), lacks) << name;
  }
}

}  // namespace
}  // namespace server
