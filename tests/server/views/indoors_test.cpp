// Tests where people stand in an interior, how they walk through it, and what is seen of it.
#include "server/views/indoors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/constants.hpp>
#include <string>
#include <vector>

#include "server/views/camera_paths.h"
#include "server/views/random_views.h"
#include "tests/server/bake/sphere.h"

namespace server {
namespace {

// Two rooms of 4 x 4 x 2.5 side by side along x, as a scanner sees them: all surfaces face inward. A door 1 wide and 2
// high joins them in the middle of the wall between.
constexpr float kWidth = 4.0F, kHeight = 2.5F, kWall = 0.125F;
constexpr float kDoorFrom = 1.5F, kDoorTo = 2.5F, kDoorHeight = 2.0F;

void addQuad(std::vector<test::Triangle>& to, const glm::vec3& corner, const glm::vec3& a, const glm::vec3& b) {
  to.push_back({corner, corner + a, corner + a + b});
  to.push_back({corner, corner + a + b, corner + b});
}

// The wall at x, around the door; it faces +x or −x.
void addWallWithDoor(std::vector<test::Triangle>& to, float x, bool faces_plus) {
  const auto piece = [&](float from, float until, float low, float high) {
    const glm::vec3 along(0.0F, until - from, 0.0F), rise(0.0F, 0.0F, high - low);
    const glm::vec3 corner(x, from, low);
    faces_plus ? addQuad(to, corner, along, rise) : addQuad(to, corner, rise, along);
  };
  piece(0.0F, kDoorFrom, 0.0F, kHeight);
  piece(kDoorTo, kWidth, 0.0F, kHeight);
  piece(kDoorFrom, kDoorTo, kDoorHeight, kHeight);
}

std::vector<test::Triangle> twoRooms() {
  std::vector<test::Triangle> rooms;
  for (const float x : {0.0F, kWidth + kWall}) {
    const glm::vec3 corner(x, 0.0F, 0.0F), along(kWidth, 0.0F, 0.0F), across(0.0F, kWidth, 0.0F),
        rise(0.0F, 0.0F, kHeight);
    addQuad(rooms, corner, along, across);
    addQuad(rooms, corner + rise, across, along);
    addQuad(rooms, corner, rise, along);
    addQuad(rooms, corner + across, along, rise);
  }
  addQuad(rooms, glm::vec3(0.0F), {0.0F, kWidth, 0.0F}, {0.0F, 0.0F, kHeight});
  addQuad(rooms, {2.0F * kWidth + kWall, 0.0F, 0.0F}, {0.0F, 0.0F, kHeight}, {0.0F, kWidth, 0.0F});
  addWallWithDoor(rooms, kWidth, false);
  addWallWithDoor(rooms, kWidth + kWall, true);
  return rooms;
}

const glm::vec3 kUp(0.0F, 0.0F, 1.0F);

class IndoorsTest : public testing::Test {
 protected:
  IndoorsTest() : rooms_(twoRooms(), {twoRooms()}, 0.01F) {
    rooms_.scene().box_max = {2.0 * double{kWidth} + double{kWall}, double{kWidth}, double{kHeight}};
    rooms_.scene().up = glm::dvec3(kUp);
    rooms_.scene().interior = true;
  }

  Indoors indoors() {
    auto found = Indoors::ofScene(rooms_.scene(), rooms_.file());
    EXPECT_TRUE(found && *found);
    return std::move(**found);
  }

  // In the box, and on the way from `before` through no wall but by the door.
  static void expectReached(const glm::vec3& before, const glm::vec3& eye, const std::string& what) {
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_GT(eye[axis], 0.0F) << what;
      EXPECT_LT(eye[axis], glm::vec3(2.0F * kWidth + kWall, kWidth, kHeight)[axis]) << what;
    }
    const float wall = kWidth + 0.5F * kWall;
    if ((before.x < wall) == (eye.x < wall)) return;
    const glm::vec3 in_wall = glm::mix(before, eye, (wall - before.x) / (eye.x - before.x));
    EXPECT_TRUE(kDoorFrom < in_wall.y && in_wall.y < kDoorTo && in_wall.z < kDoorHeight) << what;
  }

  test::TwoLevelScene rooms_;
};

TEST_F(IndoorsTest, aRoomContainsWhoStandsInIt) {
  const Indoors rooms = indoors();
  EXPECT_TRUE(rooms.contains({2.0F, 2.0F, 1.5F}));
  EXPECT_TRUE(rooms.contains({6.0F, 1.0F, 0.8F}));
  EXPECT_FALSE(rooms.contains({2.0F, 2.0F, 0.02F})) << "on the floor";
  EXPECT_FALSE(rooms.contains({kWidth + 0.06F, 0.7F, 1.0F})) << "in the wall";
  EXPECT_FALSE(rooms.contains({2.0F, -0.5F, 1.5F})) << "outside";
  EXPECT_FALSE(rooms.contains({2.0F, 2.0F, 3.0F})) << "above";
}

TEST_F(IndoorsTest, placesAreAtEyeLevelInBothRooms) {
  const Indoors rooms = indoors();
  std::size_t in_first = 0;
  for (const glm::vec3& place : rooms.places()) {
    EXPECT_TRUE(rooms.contains(place));
    EXPECT_NEAR(place.z, 0.6F * kHeight, 0.05F);
    if (place.x < kWidth) ++in_first;
  }
  EXPECT_GT(in_first, rooms.places().size() / 4);
  EXPECT_LT(in_first, rooms.places().size() * 3 / 4);
}

TEST_F(IndoorsTest, theWalkGoesThroughTheDoorAndBack) {
  const Indoors rooms = indoors();
  const std::vector<std::size_t>& walk = rooms.walk();
  ASSERT_GT(walk.size(), 10U);
  EXPECT_EQ(walk.front(), 0U);
  EXPECT_EQ(walk.back(), 0U);
  int through = 0;
  for (std::size_t i = 1; i < walk.size(); ++i) {
    const glm::vec3& from = rooms.places()[walk[i - 1]];
    const glm::vec3& to = rooms.places()[walk[i]];
    expectReached(from, to, "leg " + std::to_string(i));
    if ((from.x < kWidth) != (to.x < kWidth)) ++through;
  }
  EXPECT_GE(through, 2);
  EXPECT_EQ(through % 2, 0);
}

TEST_F(IndoorsTest, pathsStayInTheRooms) {
  const Indoors rooms = indoors();
  for (const std::string& name : pathNames()) {
    const auto path = makePath(name, rooms_.scene(), {640, 360, 30.0, 1}, &rooms);
    ASSERT_TRUE(path) << path.error().message;
    EXPECT_NEAR(path->seconds(), 30.0, 0.5) << name;
    glm::vec3 before(path->frames.front().position);
    for (const base::ViewCamera& view : path->frames) {
      const glm::vec3 eye(view.position);
      expectReached(path->jumps ? eye : before, eye, name);
      EXPECT_NEAR(glm::length(view.direction), 1.0, 1e-6);
      EXPECT_LT(std::abs(glm::dot(view.direction, glm::dvec3(kUp))), 0.7) << name;
      EXPECT_EQ(view.width, 640);
      before = eye;
    }
  }
}

TEST_F(IndoorsTest, whoWalksComesThroughBothRoomsAndTurnsAsPeopleDo) {
  const Indoors rooms = indoors();
  const auto path = makePath("walk", rooms_.scene(), {640, 360, 60.0, 1}, &rooms);
  ASSERT_TRUE(path);
  bool was_here = false, was_there = false;
  for (std::size_t i = 1; i < path->frames.size(); ++i) {
    const base::ViewCamera &a = path->frames[i - 1], &b = path->frames[i];
    const double turned = std::acos(std::min(1.0, glm::dot(a.direction, b.direction)));
    EXPECT_LE(glm::degrees(turned), 80.0 / 60.0 + 1e-3) << i;
    (b.position.x < double{kWidth} ? was_here : was_there) = true;
  }
  EXPECT_TRUE(was_here && was_there);
  EXPECT_EQ(roomsTour(rooms_.scene(), rooms, 7).size(), 7U);
}

TEST_F(IndoorsTest, anApproachEndsBeforeTheWall) {
  const Indoors rooms = indoors();
  const auto path = makePath("approach", rooms_.scene(), {640, 360, 20.0, 1}, &rooms);
  ASSERT_TRUE(path);
  const auto to_wall = [&](std::size_t frame) {
    const base::ViewCamera& view = path->frames[frame];
    return rooms.distance(glm::vec3(view.position), glm::vec3(view.direction));
  };
  EXPECT_NEAR(to_wall(240) / to_wall(0), 0.5F, 0.01F);
  EXPECT_NEAR(to_wall(1199) / to_wall(0), 0.05F, 0.01F);
}

TEST_F(IndoorsTest, randomViewsAreFromTheRooms) {
  const Indoors rooms = indoors();
  RandomViews wanted{50, 3, 0.5, 320, 180, &rooms};
  const auto enclosure = Enclosure::create(rooms_.file());
  ASSERT_TRUE(enclosure);
  const auto views = randomViews(rooms_.scene(), *enclosure, wanted);
  ASSERT_EQ(views.size(), 50U);
  int in_first = 0;
  for (const base::ViewCamera& view : views) {
    EXPECT_TRUE(rooms.contains(glm::vec3(view.position)));
    EXPECT_NEAR(glm::length(view.direction), 1.0, 1e-9);
    EXPECT_EQ(view.width, 320);
    if (view.position.x < double{kWidth}) ++in_first;
  }
  EXPECT_GT(in_first, 10);
  EXPECT_LT(in_first, 40);
  wanted.seed = 4;
  EXPECT_NE(randomViews(rooms_.scene(), *enclosure, wanted).front().position, views.front().position);
}

TEST_F(IndoorsTest, nothingElseHasRooms) {
  rooms_.scene().interior = false;
  const auto none = Indoors::ofScene(rooms_.scene(), rooms_.file());
  ASSERT_TRUE(none);
  EXPECT_FALSE(none->has_value());
}

TEST(Indoors, noRoomIsWithinAClosedModelOrOverOpenGround) {
  // A ball from outside, and the lower half of a ball from inside: a quarry as deep as wide.
  std::vector<test::Triangle> quarry = test::sphere(24, -1.0F, 0.0F);
  for (test::Triangle& t : quarry) std::swap(t.b, t.c);
  for (const auto& surface : {test::sphere(24, -1.0F, 1.0F), quarry}) {
    const test::TwoLevelScene scene(surface, {surface}, 0.01F);
    base::Aabb box;
    box.add(glm::vec3(-1.0F));
    box.add(glm::vec3(1.0F));
    EXPECT_FALSE(Indoors::find(lod::patch::ProxySight::ofFile(scene.file()).value(), box, kUp).has_value());
  }
}

}  // namespace
}  // namespace server
