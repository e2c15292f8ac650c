#include "server/views/random_views.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "repository/sampling/cube_face.h"
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

TEST(ViewerPlaces, aFaceIsDrawnAsOftenAsItWasSent) {
  const auto file = fileOf({{{0, 0, 0, 1}, 1}, {{3, 0, 0, 4}, 2}, {{4, 4, 4, 0}, 7}});
  const ViewerPlaces places({file});
  UnitRandom random(7);
  std::map<std::uint32_t, int> drawn;  // by the face's direction
  for (int i = 0; i < 10000; ++i) ++drawn[repository::faceOfDirection(places.draw(random).direction)];
  // Three standard deviations of the shares 0.1, 0.2 and 0.7 are 0.9, 1.2 and 1.4 %.
  EXPECT_NEAR(drawn[1], 1000, 90);
  EXPECT_NEAR(drawn[4], 2000, 120);
  EXPECT_NEAR(drawn[0], 7000, 140);
}

TEST(ViewerPlaces, posesLieAroundTheFacesPointAndInItsSquare) {
  const auto file = fileOf({{{2, 1, 3, 5}, 3}});
  const glm::vec3 offset(10.0F, 0.0F, -4.0F);
  const ViewerPlaces places({file}, offset);
  const glm::vec3 point = file.identity.grid.point(2, 1, 3) + offset;
  UnitRandom random(1);
  glm::vec3 low(1e9F), high(-1e9F);
  for (int i = 0; i < 1000; ++i) {
    const ViewerPlaces::Pose pose = places.draw(random);
    low = glm::min(low, pose.position);
    high = glm::max(high, pose.position);
    EXPECT_EQ(repository::faceOfDirection(pose.direction), 5U);
    EXPECT_NEAR(glm::length(pose.direction), 1.0F, 1e-5F);
  }
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(low[axis], point[axis] - 0.35F, 0.02F);
    EXPECT_NEAR(high[axis], point[axis] + 0.35F, 0.02F);
  }
}

TEST(ViewerPlaces, theSameSeedDrawsTheSamePoses) {
  const auto file = fileOf({{{0, 0, 0, 1}, 5}, {{4, 4, 4, 0}, 100}});
  const ViewerPlaces places({file});
  UnitRandom one(3), two(3);
  for (int i = 0; i < 20; ++i) {
    const auto a = places.draw(one);
    const auto b = places.draw(two);
    EXPECT_EQ(a.position, b.position);
    EXPECT_EQ(a.direction, b.direction);
  }
}

TEST(ViewerPlaces, areReadFromASceneAndSayWhatIsMissing) {
  const support::TemporaryDirectory directory;
  base::Scene scene;
  scene.box_min = glm::dvec3(-1.0);
  scene.box_max = glm::dvec3(1.0);
  scene.origin = glm::dvec3(500000.0, 100.0, 0.0);
  ASSERT_TRUE(base::writeSceneFile(scene, directory / "scene.json"));
  const auto none = ViewerPlaces::ofScene(directory.path(), scene.origin);
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("lumigrid serve"), std::string::npos) << none.error().message;

  auto file = fileOf({{{1, 1, 1, 0}, 3}});
  const std::string path = repository::accessFileOf(directory.path());
  ASSERT_TRUE(base::writeFileAtomically(path, repository::encodeAccess(file.identity, file.counts)));
  const auto places = ViewerPlaces::ofScene(directory.path(), scene.origin + glm::dvec3(2.0, 0.0, 0.0));
  ASSERT_TRUE(places) << places.error().message;
  const glm::vec3 at = file.identity.grid.point(1, 1, 1) - glm::vec3(2.0F, 0.0F, 0.0F);
  UnitRandom random(1);
  EXPECT_LE(glm::length(places->draw(random).position - at), 0.35F * 1.7321F);

  // Counts of a scene that this one replaced tell nothing about it.
  auto replaced = file;
  replaced.identity.hierarchy.fill(1);
  ASSERT_TRUE(base::writeFileAtomically(path, repository::encodeAccess(replaced.identity, replaced.counts)));
  EXPECT_FALSE(ViewerPlaces::ofScene(directory.path(), scene.origin));
  const std::string beside = repository::accessFileBeside(path, file.identity.hierarchy);
  ASSERT_TRUE(base::writeFileAtomically(beside, repository::encodeAccess(file.identity, file.counts)));
  EXPECT_TRUE(ViewerPlaces::ofScene(directory.path(), scene.origin));
  std::filesystem::remove(beside);

  file.counts.faces.clear();
  ASSERT_TRUE(base::writeFileAtomically(path, repository::encodeAccess(file.identity, file.counts)));
  EXPECT_FALSE(ViewerPlaces::ofScene(directory.path(), scene.origin));
  ASSERT_TRUE(base::writeFileAtomically(path, base::Bytes(40, 1)));
  const auto damaged = ViewerPlaces::ofScene(directory.path(), scene.origin);
  ASSERT_FALSE(damaged);
  EXPECT_EQ(damaged.error().message.rfind(path, 0), 0U) << damaged.error().message;
}

}  // namespace
}  // namespace server
