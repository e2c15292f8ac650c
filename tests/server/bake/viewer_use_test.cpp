#include "server/bake/viewer_use.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

repository::AccessFile fileOf(std::vector<std::pair<repository::FaceKey, std::uint64_t>> faces) {
  repository::AccessFile file;
  file.identity.grid.first = glm::vec3(-1.0F);
  file.identity.grid.spacing = 0.7F;
  file.identity.grid.count = glm::uvec3(5);
  file.identity.grid.face_size = 64;
  std::sort(faces.begin(), faces.end());
  file.counts.faces = std::move(faces);
  return file;
}

TEST(ViewerUse, CountsWhatLiesInABoxAndOnItsSides) {
  const auto file = fileOf({{{0, 0, 0, 1}, 5}, {{0, 0, 0, 4}, 2}, {{2, 0, 0, 0}, 10}, {{4, 4, 4, 0}, 100}});
  const ViewerUse use(file);
  const auto point = [&](std::uint32_t x, std::uint32_t y, std::uint32_t z) {
    return file.identity.grid.point(x, y, z);
  };
  EXPECT_EQ(use.within(point(0, 0, 0), point(1, 1, 1)), 7.0);
  EXPECT_EQ(use.within(point(0, 0, 0), point(2, 2, 2)), 17.0);
  EXPECT_EQ(use.within(point(2, 0, 0), point(4, 4, 4)), 110.0);
  EXPECT_EQ(use.within(point(0, 1, 0), point(4, 4, 3)), 0.0);
  const ViewerUse moved(file, glm::vec3(10.0F, 0.0F, 0.0F));
  EXPECT_EQ(moved.within(point(0, 0, 0), point(4, 4, 4)), 0.0);
  EXPECT_EQ(moved.within(point(0, 0, 0) + glm::vec3(10, 0, 0), point(4, 4, 4) + glm::vec3(10, 0, 0)), 117.0);
}

TEST(ViewerUse, IsReadFromASceneAndSaysWhatIsMissing) {
  const support::TemporaryDirectory directory;
  base::Scene scene;
  scene.box_min = glm::dvec3(-1.0);
  scene.box_max = glm::dvec3(1.0);
  scene.origin = glm::dvec3(500000.0, 100.0, 0.0);
  ASSERT_TRUE(base::writeSceneFile(scene, directory / "scene.json"));
  const auto none = ViewerUse::ofScene(directory.path(), scene.origin);
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("lumigrid serve"), std::string::npos) << none.error().message;

  auto file = fileOf({{{1, 1, 1, 0}, 3}});
  const std::string path = repository::accessFileOf(directory.path());
  ASSERT_TRUE(base::writeFileAtomically(path, repository::encodeAccess(file.identity, file.counts)));
  const auto use = ViewerUse::ofScene(directory.path(), scene.origin + glm::dvec3(2.0, 0.0, 0.0));
  ASSERT_TRUE(use) << use.error().message;
  const glm::vec3 at = file.identity.grid.point(1, 1, 1) - glm::vec3(2.0F, 0.0F, 0.0F);
  EXPECT_EQ(use->within(at, at), 3.0);

  file.counts.faces.clear();
  ASSERT_TRUE(base::writeFileAtomically(path, repository::encodeAccess(file.identity, file.counts)));
  EXPECT_FALSE(ViewerUse::ofScene(directory.path(), scene.origin));
  ASSERT_TRUE(base::writeFileAtomically(path, base::Bytes(40, 1)));
  const auto damaged = ViewerUse::ofScene(directory.path(), scene.origin);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().message.rfind(path, 0), 0U) << damaged.error().message;
}

}  // namespace
}  // namespace server
