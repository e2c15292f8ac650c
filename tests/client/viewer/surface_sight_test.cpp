// Tests the lines of sight of a viewer in the patches that came.
#include "client/viewer/surface_sight.h"

#include <gtest/gtest.h>

#include <memory>

#include "tests/client/source/scripted_server.h"

namespace client {
namespace {

class SurfaceSightTest : public ::testing::Test {
 protected:
  SurfaceSightTest() {
    session_.connected();
    EXPECT_TRUE(session_.receive(server_.sayWelcome()));
  }
  void receiveGroups(std::uint32_t count) {
    for (std::uint32_t g = 0; g < count; ++g) EXPECT_TRUE(session_.receive(server_.sayGroup(g)));
    sight_->renew(session_);
  }
  std::uint32_t groups() const { return static_cast<std::uint32_t>(server_.hierarchy().groups.size()); }
  base::Camera camera(const base::ViewCamera& view) const {
    const base::Sphere scene{0.5F * (server_.welcome.box_min + server_.welcome.box_max), 100.0F};
    return base::cameraForScene(view, server_.welcome.origin, scene);
  }
  std::size_t seenFrom(const glm::vec3& eye) const {
    std::size_t seen = 0;
    for (std::size_t i = 0; i < sight_->surface().places.size(); ++i)
      seen += sight_->surface().is_seen_from(eye, i) ? 1 : 0;
    return seen;
  }

  const ScriptedServer server_{8};
  Session session_{SessionOptions{}};
  std::unique_ptr<SurfaceSight> sight_ = makeSurfaceSight();
};

TEST_F(SurfaceSightTest, knowsNothingBeforePatchesCome) {
  sight_->renew(session_);
  EXPECT_FALSE(sight_->lookFrom(camera(server_.lookDown(20.0))));
}

TEST_F(SurfaceSightTest, findsTheSurfaceAndWhoSeesIt) {
  receiveGroups(groups());
  const base::ViewCamera view = server_.lookDown(20.0);
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  const std::size_t all = sight_->surface().places.size();
  EXPECT_GT(all, 200U);
  for (const glm::vec3& place : sight_->surface().places) {
    EXPECT_GE(place.z, server_.welcome.box_min.z - 0.1F);
    EXPECT_LE(place.z, server_.welcome.box_max.z + 0.1F);
  }
  const glm::vec3 eye(view.position - server_.welcome.origin);
  EXPECT_EQ(seenFrom(eye), all);
  EXPECT_EQ(seenFrom(eye), all) << "what is known stays";
  EXPECT_EQ(seenFrom(eye - glm::vec3(0.0F, 0.0F, 60.0F)), 0U) << "from below the other side is seen";
}

TEST_F(SurfaceSightTest, looksAnewFromAnotherPlaceAndThroughASection) {
  receiveGroups(groups());
  base::ViewCamera view = server_.lookDown(20.0);
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  const std::vector<glm::vec3> before = sight_->surface().places;
  view.position.x += 1.0;
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  EXPECT_NE(sight_->surface().places, before);
  view.section = base::SectionPlane{{1.0, 0.0, 0.0}, view.position.x};
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  EXPECT_LT(sight_->surface().places.size(), before.size());
  for (const glm::vec3& place : sight_->surface().places)
    EXPECT_LE(place.x, static_cast<float>(view.position.x - server_.welcome.origin.x) + 1e-3F);
  view.section = base::SectionPlane{{0.0, 0.0, 1.0}, server_.welcome.origin.z - 1e3};
  EXPECT_FALSE(sight_->lookFrom(camera(view))) << "nothing is left";
}

TEST_F(SurfaceSightTest, ofAMovingViewOneLookServesThoseALittleBeside) {
  receiveGroups(groups());
  base::ViewCamera view = server_.lookDown(20.0);
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  const std::vector<glm::vec3> before = sight_->surface().places;
  view.position.x += 0.1;
  ASSERT_TRUE(sight_->lookFrom(camera(view), true));
  EXPECT_EQ(sight_->surface().places, before);
  view.direction = glm::normalize(view.direction + glm::dvec3(0.005, 0.0, 0.0));
  ASSERT_TRUE(sight_->lookFrom(camera(view), true));
  EXPECT_EQ(sight_->surface().places, before);

  base::ViewCamera farther = view, turned = view, cut = view;
  farther.position.x += 1.0;
  turned.direction = glm::normalize(view.direction + glm::dvec3(0.05, 0.0, 0.0));
  cut.section = base::SectionPlane{{1.0, 0.0, 0.0}, view.position.x};
  for (const base::ViewCamera& other : {farther, turned, cut}) {
    ASSERT_TRUE(sight_->lookFrom(camera(other), true));
    EXPECT_NE(sight_->surface().places, before);
  }
  ASSERT_TRUE(sight_->lookFrom(camera(view)));
  EXPECT_NE(sight_->surface().places, before) << "a view at rest is looked at itself";
}

TEST_F(SurfaceSightTest, takesFinerPatchesIn) {
  receiveGroups(1);
  const base::Camera view = camera(server_.lookDown(20.0));
  ASSERT_TRUE(sight_->lookFrom(view));
  const std::vector<glm::vec3> coarse = sight_->surface().places;
  receiveGroups(groups());
  ASSERT_TRUE(sight_->lookFrom(view));
  EXPECT_NE(sight_->surface().places, coarse);
}

TEST_F(SurfaceSightTest, leavesParallelViewsAlone) {
  receiveGroups(groups());
  base::ViewCamera view = server_.lookDown(20.0);
  view.ortho_height = 10.0;
  EXPECT_FALSE(sight_->lookFrom(camera(view)));
}

}  // namespace
}  // namespace client
