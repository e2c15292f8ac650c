#include "lod/patch/orientation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/built_hierarchy.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace lod::patch::builder {
namespace {

using support::Mesh;

// Turns the mesh so that +z becomes the given direction along an axis.
Mesh turned(Mesh mesh, int axis, float sign) {
  for (glm::vec3& p : mesh.positions) {
    glm::vec3 q;
    q[axis] = sign * p.z;
    q[(axis + 1) % 3] = p.x;
    q[(axis + 2) % 3] = sign * p.y;
    p = q;
  }
  return mesh;
}

void append(Mesh& mesh, const Mesh& more, const glm::vec3& scale, const glm::vec3& at) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (const glm::vec3& p : more.positions) mesh.positions.push_back(scale * p + at);
  for (const std::uint32_t index : more.indices) mesh.indices.push_back(first + index);
}

// A sheet from −1 to 1 that faces +z, at height 0.
Mesh sheet() {
  Mesh mesh = support::openGrid(40, 0.0F);
  for (glm::vec3& p : mesh.positions) p = {2.0F * p.x - 1.0F, 2.0F * p.y - 1.0F, 0.0F};
  return mesh;
}

Mesh turnedOver(Mesh mesh) {
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) std::swap(mesh.indices[i], mesh.indices[i + 1]);
  return mesh;
}

// Walls around a box from 0 to `size` that face outwards.
Mesh walls(const glm::vec3& size) {
  Mesh mesh;
  for (int axis = 0; axis < 2; ++axis)
    for (const float side : {0.0F, 1.0F}) {
      Mesh wall = sheet();
      for (glm::vec3& p : wall.positions) {
        const glm::vec2 at = 0.5F * (glm::vec2(p) + 1.0F);
        glm::vec3 q(0.0F);
        q[axis] = side * size[axis];
        q[1 - axis] = at.x * size[1 - axis];
        q.z = at.y * size.z;
        p = q;
      }
      append(mesh, (side > 0.0F) == (axis == 0) ? wall : turnedOver(wall), glm::vec3(1.0F), glm::vec3(0.0F));
    }
  return mesh;
}

// A floor or, turned over, a ceiling of the box from 0 to `size`.
void appendLevel(Mesh& mesh, const Mesh& level, const glm::vec3& size, float height) {
  append(mesh, level, glm::vec3(0.5F * size.x, 0.5F * size.y, 1.0F), glm::vec3(0.5F * size.x, 0.5F * size.y, height));
}

class OrientationTest : public testing::Test {
 protected:
  Orientation orientationOf(const Mesh& mesh, const glm::vec3* up = nullptr,
                            InteriorChoice interior = InteriorChoice::kAuto) {
    const auto built = support::buildHierarchy(mesh, {}, directory_ / "patch.lgp");
    EXPECT_TRUE(built) << built.error().message;
    const auto file = lod::patch::PatchFile::open(directory_ / "patch.lgp");
    EXPECT_TRUE(file) << file.error().message;
    const auto found = findOrientation(*file, up, interior);
    EXPECT_TRUE(found) << found.error().message;
    return *found;
  }
  const support::TemporaryDirectory directory_;
};

TEST_F(OrientationTest, groundFacesUpWhicheverAxisThatIs) {
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      const Orientation found = orientationOf(turned(support::openGrid(60, 0.02F), axis, sign));
      EXPECT_EQ(found.up[axis], sign) << axis << ": " << found.reason;
      EXPECT_TRUE(found.is_sure);
      EXPECT_NE(found.reason.find("ground"), std::string::npos) << found.reason;
      EXPECT_LT(glm::dot(found.direction, found.up), -0.5F) << "looks down on a flat scan";
    }
}

TEST_F(OrientationTest, aStatueStandsOnItsBase) {
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      Mesh statue;
      append(statue, support::bumpySphere(60, 60), glm::vec3(1.0F, 1.0F, 1.6F), glm::vec3(0.0F, 0.0F, 1.4F));
      // A sheet that faces down closes it below.
      append(statue, turnedOver(sheet()), glm::vec3(0.8F, 0.8F, 1.0F), glm::vec3(0.0F, 0.0F, -0.25F));
      const Orientation found = orientationOf(turned(statue, axis, sign));
      EXPECT_EQ(found.up[axis], sign) << axis << ": " << found.reason;
      EXPECT_TRUE(found.is_sure) << found.reason;
      EXPECT_NE(found.reason.find("base"), std::string::npos) << found.reason;
    }
}

// The ceiling faces down as much as the floor faces up; but what stands in the room is low.
TEST_F(OrientationTest, aRoomWithItsCeilingStandsAsItsFurnitureDoes) {
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      Mesh room;
      append(room, sheet(), glm::vec3(1.0F), glm::vec3(0.0F));
      append(room, turnedOver(sheet()), glm::vec3(1.0F), glm::vec3(0.0F, 0.0F, 0.6F));
      for (const float x : {-0.6F, 0.0F, 0.5F})
        append(room, support::bumpySphere(20, 20), glm::vec3(0.15F), glm::vec3(x, 0.3F * x, 0.2F));
      const Orientation found = orientationOf(turned(room, axis, sign));
      EXPECT_EQ(found.up[axis], sign) << axis << ": " << found.reason;
      EXPECT_FALSE(found.is_sure);
    }
}

// A room of the given size from `corner` on, scanned from inside.
void appendRoom(Mesh& mesh, const glm::vec3& size, const glm::vec3& corner) {
  Mesh room = turnedOver(walls(size));
  appendLevel(room, sheet(), size, 0.0F);
  appendLevel(room, turnedOver(sheet()), size, size.z);
  append(mesh, room, glm::vec3(1.0F), corner);
}

// Four rooms on each storey, of which the walls are larger than floors and ceilings, as flats have them. The back of a
// wardrobe lies at the end of the scan and faces outwards, as a base does.
Mesh houseOfRooms(int storeys) {
  Mesh house;
  for (int storey = 0; storey < storeys; ++storey) {
    const float floor = 2.7F * static_cast<float>(storey);
    appendRoom(house, {4.9F, 3.9F, 2.6F}, {0.0F, 0.0F, floor});
    appendRoom(house, {3.9F, 3.9F, 2.6F}, {5.0F, 0.0F, floor});
    appendRoom(house, {3.4F, 3.5F, 2.6F}, {0.0F, 4.0F, floor});
    appendRoom(house, {5.4F, 3.5F, 2.6F}, {3.5F, 4.0F, floor});
    for (const float x : {0.01F, 8.28F}) {
      Mesh wardrobe = walls({0.6F, 2.5F, 2.0F});
      appendLevel(wardrobe, sheet(), {0.6F, 2.5F, 2.0F}, 2.0F);
      append(house, wardrobe, glm::vec3(1.0F), {x, 1.0F, floor});
    }
  }
  return house;
}

// With more storeys the house is as high as it is wide.
TEST_F(OrientationTest, roomsStandOnTheirFloorsThoughTheirWallsAreLarger) {
  for (const int storeys : {1, 3})
    for (int axis = 0; axis < 3; ++axis)
      for (const float sign : {1.0F, -1.0F}) {
        const Orientation found = orientationOf(turned(houseOfRooms(storeys), axis, sign));
        EXPECT_EQ(found.up[axis], sign) << storeys << ", " << axis << ": " << found.reason;
        EXPECT_TRUE(found.is_interior) << storeys << ", " << axis;
      }
}

// A scanner sees nothing behind furniture, and nothing of glass.
TEST_F(OrientationTest, roomsWithHolesStandOnTheirFloorsToo) {
  const Mesh whole = houseOfRooms(1);
  Mesh scan = whole;
  scan.indices.clear();
  for (std::size_t i = 0; i < whole.indices.size(); i += 3) {
    const glm::vec3 p = whole.positions[whole.indices[i]];
    if (std::sin(2.3F * p.x) * std::sin(2.1F * p.y + 1.0F) * std::sin(2.7F * p.z + 0.7F) > 0.3F) continue;
    scan.indices.insert(scan.indices.end(), {whole.indices[i], whole.indices[i + 1], whole.indices[i + 2]});
  }
  EXPECT_LT(scan.indices.size(), whole.indices.size() * 9 / 10);
  const Orientation found = orientationOf(turned(scan, 1, 1.0F));
  EXPECT_EQ(found.up, glm::vec3(0.0F, 1.0F, 0.0F)) << found.reason;
  EXPECT_FALSE(found.is_enclosed);
}

// A building without its lower side, which nobody sees: its roof is as flat as a base.
TEST_F(OrientationTest, aBlockStandsOnItsOpenSide) {
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      const glm::vec3 size(2.0F, 1.5F, 1.2F);
      Mesh block = walls(size);
      appendLevel(block, sheet(), size, size.z);
      const Orientation found = orientationOf(turned(block, axis, sign));
      EXPECT_EQ(found.up[axis], sign) << axis << ": " << found.reason;
      EXPECT_FALSE(found.section_height.has_value());
    }
}

TEST_F(OrientationTest, aColumnStandsOnOneOfItsEnds) {
  for (int axis = 0; axis < 3; ++axis) {
    Mesh column;
    const auto round = static_cast<std::uint32_t>(64);
    for (std::uint32_t ring = 0; ring <= 40; ++ring)
      for (std::uint32_t i = 0; i < round; ++i) {
        const float angle = 6.2831853F * static_cast<float>(i) / static_cast<float>(round);
        column.positions.emplace_back(std::cos(angle), std::sin(angle), 0.15F * static_cast<float>(ring));
        if (ring == 0) continue;
        const std::uint32_t a = (ring - 1) * round + i, b = (ring - 1) * round + (i + 1) % round;
        for (const std::uint32_t index : {a, b, b + round, a, b + round, a + round}) column.indices.push_back(index);
      }
    for (const std::uint32_t ring : {0U, 40U}) {
      const auto middle = static_cast<std::uint32_t>(column.positions.size());
      column.positions.emplace_back(0.0F, 0.0F, 0.15F * static_cast<float>(ring));
      for (std::uint32_t i = 0; i < round; ++i) {
        const std::uint32_t a = ring * round + i, b = ring * round + (i + 1) % round;
        for (const std::uint32_t index : {middle, ring == 0 ? b : a, ring == 0 ? a : b})
          column.indices.push_back(index);
      }
    }
    const Orientation found = orientationOf(turned(column, axis, 1.0F));
    EXPECT_EQ(found.up[axis], 1.0F) << axis << ": " << found.reason;
    EXPECT_FALSE(found.is_sure);
  }
}

TEST_F(OrientationTest, aCrateHasNoBase) {
  Mesh crate = walls(glm::vec3(1.0F));
  appendLevel(crate, sheet(), glm::vec3(1.0F), 1.0F);
  appendLevel(crate, turnedOver(sheet()), glm::vec3(1.0F), 0.0F);
  const Orientation found = orientationOf(crate);
  EXPECT_EQ(found.up, glm::vec3(0.0F, 1.0F, 0.0F)) << found.reason;
  EXPECT_NE(found.reason.find("nothing tells"), std::string::npos) << found.reason;
}

// Two storeys, scanned from inside: from above the backs of the upper ceilings are seen, and of two rooms of the upper
// storey one is lower than the other.
TEST_F(OrientationTest, anInteriorIsCutOpenBelowTheCeilingsOfItsTopStorey) {
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      const glm::vec3 size(4.0F, 3.0F, 2.4F);
      Mesh house = turnedOver(walls(size));
      for (const float floor : {0.0F, 1.25F}) appendLevel(house, sheet(), size, floor);
      appendLevel(house, turnedOver(sheet()), size, 1.15F);
      append(house, turnedOver(sheet()), glm::vec3(1.0F, 1.5F, 1.0F), glm::vec3(1.0F, 1.5F, 2.4F));
      append(house, turnedOver(sheet()), glm::vec3(1.0F, 1.5F, 1.0F), glm::vec3(3.0F, 1.5F, 2.2F));
      glm::vec3 up(0.0F);
      up[axis] = sign;
      const Orientation found = orientationOf(turned(house, axis, sign), &up);
      ASSERT_TRUE(found.section_height.has_value()) << axis;
      EXPECT_LT(*found.section_height, 2.2F);
      EXPECT_GT(*found.section_height, 2.0F);
      EXPECT_LT(glm::dot(found.direction, up), -0.6F) << "looks into the rooms";
    }
}

// A nave beneath a barrel vault, scanned from inside: two thirds of the ceiling are far from level. Or a hall with a
// level ceiling above a floor that rises by 35 degrees, as that of a theatre.
TEST_F(OrientationTest, anInteriorMayHaveAVaultOrASteepFloor) {
  const glm::vec3 up(0.0F, 0.0F, 1.0F);
  const glm::vec3 size(2.0F, 5.0F, 1.4F);
  Mesh nave = turnedOver(walls(size));
  appendLevel(nave, sheet(), size, 0.0F);
  Mesh vault = sheet();
  for (glm::vec3& p : vault.positions) {
    const float angle = 1.57079633F * p.x;
    p = {1.0F + std::sin(angle), 2.5F * (1.0F + p.y), size.z + std::cos(angle)};
  }
  append(nave, turnedOver(vault), glm::vec3(1.0F), glm::vec3(0.0F));
  const Orientation found = orientationOf(nave, &up);
  ASSERT_TRUE(found.section_height.has_value());
  EXPECT_LT(*found.section_height, size.z + 0.5F) << "below most of the vault";
  EXPECT_GT(*found.section_height, 0.5F * size.z);

  Mesh theatre = turnedOver(walls(glm::vec3(2.0F, 2.0F, 3.0F)));
  appendLevel(theatre, turnedOver(sheet()), glm::vec3(2.0F), 3.0F);
  Mesh rise = sheet();
  for (glm::vec3& p : rise.positions) p.z = 0.7F * (1.0F + p.x);
  append(theatre, rise, glm::vec3(1.0F), glm::vec3(1.0F, 1.0F, 0.0F));
  EXPECT_TRUE(orientationOf(theatre, &up).section_height.has_value());
}

TEST_F(OrientationTest, passagesOfACaveAreAnInteriorAndAPipeIsNone) {
  const Orientation level = orientationOf(support::cave());
  EXPECT_TRUE(level.is_interior);
  EXPECT_EQ(level.up, glm::vec3(0.0F, 0.0F, 1.0F));
  EXPECT_TRUE(level.section_height.has_value());
  const Orientation steep = orientationOf(support::cave(20.0F));
  EXPECT_TRUE(steep.is_interior);
  EXPECT_EQ(steep.up, glm::vec3(0.0F, 0.0F, 1.0F));
  EXPECT_FALSE(steep.section_height.has_value()) << "no height opens half of it";
  const Orientation pipe = orientationOf(turnedOver(support::cave()));
  EXPECT_FALSE(pipe.is_interior);
  EXPECT_FALSE(pipe.section_height.has_value());
}

TEST_F(OrientationTest, anInteriorIsWhatIsSaidToBeOne) {
  const glm::vec3 z(0.0F, 0.0F, 1.0F);
  const Mesh grotto = turnedOver(support::bumpySphere(60, 60));
  EXPECT_FALSE(orientationOf(grotto, &z).is_interior);
  const Orientation said = orientationOf(grotto, &z, InteriorChoice::kOn);
  EXPECT_TRUE(said.is_interior);
  EXPECT_TRUE(said.section_height.has_value());
  const Orientation denied = orientationOf(support::cave(), &z, InteriorChoice::kOff);
  EXPECT_FALSE(denied.is_interior);
  EXPECT_FALSE(denied.section_height.has_value());
  // Up along no axis.
  const glm::vec3 slanted = glm::normalize(glm::vec3(0.2F, 0.3F, 1.0F));
  EXPECT_TRUE(orientationOf(support::cave(), &slanted, InteriorChoice::kOn).is_interior);
}

TEST_F(OrientationTest, nothingElseIsCutOpen) {
  const glm::vec3 z(0.0F, 0.0F, 1.0F);
  const glm::vec3 size(4.0F, 3.0F, 1.0F);
  // A closed building seen from outside, a statue turned inside out, ground that faces down, a room without a floor.
  Mesh building = walls(size);
  appendLevel(building, sheet(), size, 1.0F);
  appendLevel(building, turnedOver(sheet()), size, 0.0F);
  Mesh open_below = turnedOver(walls(size));
  appendLevel(open_below, turnedOver(sheet()), size, 1.0F);
  for (const Mesh& mesh :
       {building, turnedOver(support::bumpySphere(60, 60)), turnedOver(support::openGrid(60, 0.02F)), open_below})
    EXPECT_FALSE(orientationOf(mesh, &z).is_interior);
}

TEST_F(OrientationTest, whereNothingTellsItSaysSo) {
  const Orientation found = orientationOf(support::bumpySphere(80, 80, 0.01F));
  EXPECT_EQ(found.up, glm::vec3(0.0F, 1.0F, 0.0F));
  EXPECT_FALSE(found.is_sure);
  EXPECT_NE(found.reason.find("nothing tells"), std::string::npos);
}

// A relief on one side of a slab, of which the other side is bare and behind which nothing is seen.
TEST_F(OrientationTest, theFirstViewShowsTheSideWithMostToSee) {
  for (const float side : {1.0F, -1.0F}) {
    Mesh slab;
    append(slab, support::openGrid(120, 0.2F), glm::vec3(1.0F), glm::vec3(0.0F));
    append(slab, support::openGrid(2, 0.0F), glm::vec3(1.0F), glm::vec3(0.0F, 0.0F, -0.4F));
    const glm::vec3 up(0.0F, 1.0F, 0.0F);
    for (glm::vec3& p : slab.positions) p = {p.x * side, p.y, p.z * side};
    const Orientation found = orientationOf(slab, &up);
    EXPECT_EQ(found.up, up);
    EXPECT_LT(side * found.direction.z, -0.6F);
    EXPECT_LT(found.direction.y, 0.0F);
    EXPECT_NEAR(glm::length(found.direction), 1.0F, 1e-5F);
  }
}

// A sheet that stands, as a scanned house front does: what is seen from behind is the same, mirrored.
TEST_F(OrientationTest, theFirstViewOfAnOpenScanIsFromItsFront) {
  for (const float side : {1.0F, -1.0F}) {
    Mesh front = support::openGrid(60, 0.1F);
    for (glm::vec3& p : front.positions) p = {p.x * side, p.y, p.z * side};
    const glm::vec3 up(0.0F, 1.0F, 0.0F);
    EXPECT_LT(side * orientationOf(front, &up).direction.z, -0.6F);
  }
}

}  // namespace
}  // namespace lod::patch::builder
