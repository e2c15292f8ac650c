// Which way is up, and from where a scan is looked at first, as the whole program finds them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <glm/glm.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/json/scene_file.h"
#include "tests/programs/run_program.h"
#include "tests/support/ply_file.h"
#include "tests/support/test_meshes.h"

namespace {

using programs::run;

class FirstViewOfScan : public programs::ProgramTest {
 protected:
  void write(const support::Mesh& mesh) const { support::writePly(path("scan.ply"), mesh); }
  /// Returns what the build says.
  std::string build(const std::vector<std::string>& options = {}) const {
    std::vector<std::string> words{"build", path("scan.ply"), "-o", path("scene"), "--methods", "patch", "--force"};
    words.insert(words.end(), options.begin(), options.end());
    const auto built = run("lumigrid", words);
    EXPECT_EQ(built.status, 0) << built.err;
    return built.err;
  }
  base::Scene scene() const { return base::readScene(path("scene")).value(); }
};

/// The place of a link "v=1&p=x,y,z&...".
glm::dvec3 placeOf(const std::string& link) {
  glm::dvec3 place(0.0);
  EXPECT_EQ(std::sscanf(link.c_str(), "v=1&p=%lf,%lf,%lf&a=", &place.x, &place.y, &place.z), 3) << link;
  return place;
}

TEST_F(FirstViewOfScan, beginsInAPassageOfACaveThatNoCutOpens) {
  support::Mesh cave = support::cave(20.0F);
  cave.origin = {1000.0, 2000.0, 300.0};
  write(cave);
  const std::string said = build();
  EXPECT_NE(said.find("interior: images are for eyes in its rooms"), std::string::npos) << said;
  const base::Scene found = scene();
  EXPECT_TRUE(found.interior);
  EXPECT_GT(found.interior_grid, 30U) << "the passage is 2 to 3 wide and 60 long";
  EXPECT_LT(found.interior_grid, 90U);
  // The passage's middle is known.
  const glm::dvec3 eye = placeOf(found.start_view) - cave.origin;
  const double t = eye.x / 60.0;
  EXPECT_LT(glm::length(glm::dvec2(eye.y - 6.0 * std::sin(9.0 * t), eye.z - 20.0 * t)), 1.2) << found.start_view;

  // With another up the view that was found is found anew; one that somebody chose stays.
  ASSERT_EQ(run("lumigrid", {"set", path("scene"), "--up", "-z"}).status, 0);
  EXPECT_NE(scene().start_view, found.start_view);
  ASSERT_EQ(run("lumigrid", {"set", path("scene"), "--up", "z"}).status, 0);
  EXPECT_EQ(scene().start_view, found.start_view);
  const std::string chosen = "v=1&p=1001,2000,300&a=0,0&r=2";
  ASSERT_EQ(run("lumigrid", {"set", path("scene"), "--start-view", chosen}).status, 0);
  ASSERT_EQ(run("lumigrid", {"set", path("scene"), "--up", "-z"}).status, 0);
  EXPECT_EQ(scene().start_view, chosen);
}

TEST_F(FirstViewOfScan, isFromAroundWhatIsSaidToBeNoInterior) {
  write(support::cave());
  build({"--interior", "off"});
  EXPECT_FALSE(scene().interior);
  EXPECT_EQ(scene().interior_grid, 0U);
  EXPECT_EQ(scene().start_view, "");
  EXPECT_EQ(scene().parameters.at("interior"), "off");
  // The scene remembers it.
  ASSERT_EQ(run("lumigrid", {"set", path("scene"), "--start-view", "auto"}).status, 0);
  EXPECT_EQ(scene().start_view, "");
  programs::expectOneLineError(run("lumigrid", {"build", path("scan.ply"), "-o", path("scene"), "--methods", "patch"}),
                               1, {"other meshes or options"});
}

TEST_F(FirstViewOfScan, surfaceThatFacesInwardsIsOnlyAnInteriorWhereThatIsSaid) {
  support::Mesh grotto = support::bumpySphere(60, 60);
  for (std::size_t i = 0; i < grotto.indices.size(); i += 3) std::swap(grotto.indices[i], grotto.indices[i + 1]);
  grotto.normals.clear();
  write(grotto);
  const std::string said = build();
  EXPECT_FALSE(scene().interior);
  EXPECT_NE(said.find("--interior on"), std::string::npos) << said;
  build({"--interior", "on"});
  EXPECT_TRUE(scene().interior);
  write(support::openGrid(40));
  EXPECT_NE(build({"--interior", "on"}).find("no room is found"), std::string::npos);
  EXPECT_FALSE(scene().interior);
}

// A hillside of 30 degrees: nothing of it faces an axis within 20.
TEST_F(FirstViewOfScan, hasHeightsOfMapCoordinatesUpwards) {
  support::Mesh hill = support::openGrid(30, 0.02F);
  for (glm::vec3& p : hill.positions) p = 80.0F * glm::vec3(p.x, p.y, p.z + 0.58F * p.y);
  hill.origin = {412345.0, 5160200.0, 2210.0};
  write(hill);
  EXPECT_NE(build().find("up: z, since its coordinates are a map's"), std::string::npos);
  EXPECT_EQ(scene().up, glm::dvec3(0.0, 0.0, 1.0));
  // Heights as y, northings turned round.
  for (glm::vec3& p : hill.positions) p = {p.x, p.z, -p.y};
  hill.origin = {412345.0, 2210.0, -5160200.0};
  write(hill);
  EXPECT_NE(build().find("up: y, since its coordinates are a map's"), std::string::npos);
  EXPECT_EQ(scene().up, glm::dvec3(0.0, 1.0, 0.0));
  // Said by hand, and far from any map.
  build({"--up", "x"});
  EXPECT_EQ(scene().up, glm::dvec3(1.0, 0.0, 0.0));
  hill.origin = {10.0, 20.0, 30.0};
  write(hill);
  EXPECT_EQ(build().find("a map's"), std::string::npos);
}

}  // namespace
