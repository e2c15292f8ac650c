#include "lod/patch/orientation.h"

#include <gtest/gtest.h>

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
  return support::openGrid(40, 0.0F);
}

class OrientationTest : public testing::Test {
 protected:
  Orientation orientationOf(const Mesh& mesh, const glm::vec3* up = nullptr) {
    const auto built = support::buildHierarchy(mesh, {}, directory_ / "patch.lgp");
    EXPECT_TRUE(built) << built.error().message;
    const auto file = lod::patch::PatchFile::open(directory_ / "patch.lgp");
    EXPECT_TRUE(file) << file.error().message;
    const auto found = findOrientation(*file, up);
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
      append(statue, sheet(), glm::vec3(0.8F, -0.8F, 1.0F), glm::vec3(0.0F, 0.0F, -0.25F));
      for (std::size_t i = statue.indices.size() - sheet().indices.size(); i < statue.indices.size(); i += 3)
        std::swap(statue.indices[i], statue.indices[i + 1]);
      for (std::size_t v = statue.positions.size() - sheet().positions.size(); v < statue.positions.size(); ++v)
        statue.positions[v].y *= -1.0F;
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
      Mesh ceiling = sheet();
      for (std::size_t i = 0; i < ceiling.indices.size(); i += 3) std::swap(ceiling.indices[i], ceiling.indices[i + 1]);
      append(room, ceiling, glm::vec3(1.0F), glm::vec3(0.0F, 0.0F, 0.6F));
      for (const float x : {-0.6F, 0.0F, 0.5F})
        append(room, support::bumpySphere(20, 20), glm::vec3(0.15F), glm::vec3(x, 0.3F * x, 0.2F));
      const Orientation found = orientationOf(turned(room, axis, sign));
      EXPECT_EQ(found.up[axis], sign) << axis << ": " << found.reason;
      EXPECT_FALSE(found.is_sure);
    }
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
