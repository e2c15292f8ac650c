#include "client/render/sample_borders.h"

#include <gtest/gtest.h>

#include <deque>

#include "repository/sampling/cube_face.h"
#include "tests/client/render/ray_scene.h"

namespace client {
namespace {

using repository::FaceKey;

base::Camera cameraAt(const glm::vec3& eye, const glm::vec3& target, int size, float fov_degrees) {
  return testing_scene::lookAt(eye, target, size, size, fov_degrees);
}

class Borders : public ::testing::Test {
 protected:
  void add(const base::Camera& camera, float fade = 1.0F, float core = 1.0F) {
    geometry_.emplace_back(camera, core);
    pointers_.push_back(&geometry_.back());
    fades_.push_back(fade);
  }
  std::vector<SampleBorders> borders() const { return bordersOf(pointers_, fades_, nestingOf(pointers_)); }
  std::deque<SampleGeometry> geometry_;
  std::vector<const SampleGeometry*> pointers_;
  std::vector<float> fades_;
};

TEST_F(Borders, facesOfACubeGoOnIntoEachOther) {
  const glm::vec3 eye(1, 2, 3);
  for (const glm::vec3 d : {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0),
                            glm::vec3(0, 0, 1), glm::vec3(0, 0, -1)})
    add(cameraAt(eye, eye + d, 128, 90));
  for (const SampleBorders& border : borders()) {
    EXPECT_EQ(border.floors, glm::vec4(1.0F));
    EXPECT_EQ(border.beyond, glm::vec4(0.0F));
    EXPECT_EQ(border.under, 0.0F);
  }
}

TEST_F(Borders, onlyTheSharedSideKeepsItsWeight) {
  // Looking along +x with +z up, +y is at the left.
  add(cameraAt(glm::vec3(0.0F), {1, 0, 0}, 128, 90));
  add(cameraAt(glm::vec3(0.0F), {0, 1, 0}, 128, 90), 0.25F);
  EXPECT_EQ(borders()[0].floors, glm::vec4(0.25F, 0, 0, 0))
      << "sinks to the weight of the neighbour that is still coming in";
  EXPECT_EQ(borders()[1].floors, glm::vec4(0, 1, 0, 0));
}

TEST_F(Borders, facesOfAnotherPointAreNoNeighbours) {
  add(cameraAt(glm::vec3(0.0F), {1, 0, 0}, 128, 90));
  add(cameraAt({0, 0, 1}, {0, 1, 1}, 128, 90));
  for (const SampleBorders& border : borders()) EXPECT_EQ(border.floors, glm::vec4(0.0F));
}

//   Depth 1 and depth 2 of a face, by (x, y) from the left and the top:
//        +-------+-------+           +---+---+---+---+
//        | 0,0   | 1,0   |           |0,0|1,0|2,0|3,0|
//        |       |       |           +---+---+---+---+
//        +-------+-------+           |0,1|1,1|2,1|3,1|
class TileBorders : public Borders {
 protected:
  void addTile(std::uint32_t d, const repository::TilePlace& place, float fade = 1.0F) {
    add(repository::faceCamera(grid_, {3, 1, 2, d, repository::tileAt(place)}, {glm::vec3(0.0F), 10.0F}), fade,
        248.0F / 256.0F);
  }
  const repository::Grid grid_ =
      repository::withTiles(repository::makeGrid({glm::vec3(-1.0F), glm::vec3(1.0F)}, 5, 0.5F, 256), 5);
};

TEST_F(TileBorders, tilesOfADepthGoOnIntoEachOther) {
  for (const std::uint32_t y : {14U, 15U, 16U})
    for (const std::uint32_t x : {7U, 8U, 9U}) addTile(2, {5, x, y});
  EXPECT_EQ(borders()[4].floors, glm::vec4(1.0F)) << "the one in the middle";
  EXPECT_EQ(borders()[0].floors, glm::vec4(0, 1, 1, 0)) << "at the upper left";
  EXPECT_EQ(borders()[8].floors, glm::vec4(1, 0, 0, 1)) << "at the lower right";
}

TEST_F(TileBorders, tilesMeetAcrossTheEdgeOfTwoFaces) {
  // The left side of +x is the right side of +y.
  addTile(0, {2, 0, 1});
  addTile(2, {2, 3, 1});
  EXPECT_EQ(borders()[0].floors, glm::vec4(1, 0, 0, 0));
  EXPECT_EQ(borders()[1].floors, glm::vec4(0, 1, 0, 0));
}

TEST_F(TileBorders, aTileFadesOutOverACoarserOneThatGoesOn) {
  addTile(0, {1, 0, 0});
  addTile(0, {2, 0, 0}, 0.5F);  // its left and upper sides are those of the coarser one
  EXPECT_EQ(borders()[0].floors, glm::vec4(0.0F));
  EXPECT_EQ(borders()[0].under, 0.0F);
  EXPECT_EQ(borders()[1].floors, glm::vec4(0.0F));
  EXPECT_EQ(borders()[1].beyond, glm::vec4(0, -1, -1, 0));
  EXPECT_EQ(borders()[1].under, 1.0F);
}

TEST_F(TileBorders, aTileFadesOutOverACoarserOneAlsoWhereThatMeetsItsNeighbour) {
  addTile(0, {1, 0, 0});
  addTile(0, {1, 1, 0}, 0.25F);
  addTile(0, {3, 3, 1});
  EXPECT_EQ(borders()[0].floors, glm::vec4(0, 0.25F, 0, 0));
  EXPECT_EQ(borders()[2].floors, glm::vec4(0, 0.25F, 0, 0)) << "beyond is one that is twice as coarse";
  EXPECT_EQ(borders()[2].beyond, glm::vec4(-1, 2, -1, -1));
}

TEST_F(TileBorders, tilesOfTwoDepthsMeetAsCoarseAsTheCoarser) {
  addTile(0, {1, 0, 0});
  addTile(0, {2, 2, 0});
  addTile(0, {2, 2, 1});
  EXPECT_EQ(borders()[0].floors, glm::vec4(0, 1, 0, 0));
  EXPECT_EQ(borders()[0].beyond, glm::vec4(0.0F));
  EXPECT_EQ(borders()[1].floors, glm::vec4(1, 0, 1, 0));
  EXPECT_EQ(borders()[1].beyond, glm::vec4(1, 0, 0, 0));
  EXPECT_EQ(borders()[2].beyond, glm::vec4(1, 0, 0, 0));
}

TEST_F(TileBorders, aCoarserTileKeepsNoWeightForAHalfOfItsSide) {
  addTile(0, {1, 0, 0});
  addTile(0, {2, 2, 0});
  EXPECT_EQ(borders()[0].floors, glm::vec4(0.0F));
  EXPECT_EQ(borders()[1].floors, glm::vec4(0.0F)) << "so the finer one keeps none either";
}

TEST(SampleNesting, tilesLieInThoseThatTheyArePartsOf) {
  const repository::Grid grid =
      repository::withTiles(repository::makeGrid({glm::vec3(-1.0F), glm::vec3(1.0F)}, 5, 0.5F, 256), 5);
  std::deque<SampleGeometry> geometry;
  std::vector<const SampleGeometry*> samples;
  for (const FaceKey& key : {FaceKey{1, 1, 1, 0, 0}, FaceKey{1, 1, 1, 1, 2}, FaceKey{1, 1, 1, 0, 2},
                             FaceKey{1, 1, 1, 0, repository::childOfTile(2, 3)}, FaceKey{1, 1, 2, 0, 2}}) {
    geometry.emplace_back(repository::faceCamera(grid, key, {glm::vec3(0.0F), 10.0F}), 248.0F / 256.0F);
    samples.push_back(&geometry.back());
  }
  const SampleNesting nesting = nestingOf(samples);
  EXPECT_EQ(nesting.finer[0], (std::vector<std::uint32_t>{2, 3}));
  EXPECT_EQ(nesting.finer[2], (std::vector<std::uint32_t>{3}));
  EXPECT_EQ(nesting.coarser[3], (std::vector<std::uint32_t>{0, 2}));
  EXPECT_TRUE(nesting.finer[1].empty() && nesting.coarser[1].empty()) << "another face";
  EXPECT_TRUE(nesting.finer[4].empty() && nesting.coarser[4].empty()) << "another point";
  std::vector<std::uint32_t> groups;
  EXPECT_EQ(finestFirst(samples, nesting, &groups), (std::vector<std::uint32_t>{3, 2, 0, 1, 4}));
  EXPECT_EQ(groups, (std::vector<std::uint32_t>{0, 0, 0, 1, 4}));
}

}  // namespace
}  // namespace client
