#include "server/bake/face_sample.h"

#include <gtest/gtest.h>

#include <set>

#include "base/egl/headless.h"
#include "repository/sampling/cube_face.h"
#include "server/bake/face_encoder.h"
#include "tests/server/render/two_level_scene.h"

namespace server {
namespace {

using repository::FaceKey;

repository::Grid gridOf(glm::uvec3 count) {
  repository::Grid grid;
  grid.first = glm::vec3(-2.0F);
  grid.count = count;
  grid.face_size = 32;
  return grid;
}

TEST(FaceOrder, everyFaceComesOnce) {
  for (const glm::uvec3 count : {glm::uvec3(2, 2, 2), glm::uvec3(3, 3, 3), glm::uvec3(5, 2, 7), glm::uvec3(16, 9, 4)}) {
    const repository::Grid grid = gridOf(count);
    const FaceOrder order(grid);
    std::set<std::uint64_t> seen;
    for (std::uint64_t n = 0; n < order.count(); ++n) {
      const FaceKey key = order.face(n);
      EXPECT_TRUE(grid.contains(key));
      seen.insert(key.code());
    }
    EXPECT_EQ(seen.size(), grid.faceCount());
  }
}

// Each eighth of the Morton order has 12 of the first 96 of 20 736 faces, give or take a few, and each direction 16.
TEST(FaceOrder, aBeginningIsSpreadOverTheOrderAndTheDirections) {
  const repository::Grid grid = gridOf({12, 24, 12});
  const FaceOrder order(grid);
  const auto points = repository::pointsInMortonOrder(grid);
  std::array<int, 8> eighths{};
  std::array<int, 6> directions{};
  for (std::uint64_t n = 0; n < 96; ++n) {
    const FaceKey key = order.face(n);
    const auto place = std::find(points.begin(), points.end(), glm::uvec3(key.x, key.y, key.z)) - points.begin();
    ++eighths[static_cast<std::size_t>(place) * 8 / points.size()];
    ++directions[key.d];
  }
  for (const int count : eighths) EXPECT_NEAR(count, 12, 2);
  for (const int count : directions) EXPECT_NEAR(count, 16, 8);
}

// The scene is a square in the plane z = 0 between −1 and 1.
std::vector<test::Triangle> square() {
  const glm::u8vec4 color(200, 100, 50, 255);
  return {{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, color}, {{-1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, color}};
}

class FaceSampleTest : public testing::Test {
 protected:
  FaceSampleTest() : scene_(square(), {square()}, 0.1F) {
    context_ = std::move(*base::HeadlessContext::create());
    renderer_ = std::move(*SceneRenderer::create(scene_.scene(), scene_.file()));
  }
  test::TwoLevelScene scene_;
  std::unique_ptr<base::HeadlessContext> context_;
  std::unique_ptr<SceneRenderer> renderer_;
};

TEST_F(FaceSampleTest, itTakesTheFirstFacesThatShowTheModel) {
  const repository::Grid grid = repository::makeGrid(base::Aabb{{-1, -1, 0}, {1, 1, 0}}, 4, 0.5F, 32);
  const FaceOrder order(grid);
  std::vector<base::Image> expected;
  for (std::uint64_t n = 0; n < order.count() && expected.size() < 5; ++n) {
    auto rendered = renderer_->render(faceCameras(*renderer_, grid, {order.face(n)}).front(), {});
    ASSERT_TRUE(rendered);
    if (showsModel(rendered->rgba)) expected.push_back(std::move(rendered->rgba));
  }
  const auto sample = sampleFaces(*renderer_, grid, {}, 5);
  ASSERT_TRUE(sample) << sample.error().message;
  ASSERT_EQ(sample->size(), 5U);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_EQ((*sample)[i].pixels, expected[i].pixels) << i;
}

TEST_F(FaceSampleTest, itTakesAllThereAreAndNoneWhereNothingIsSeen) {
  const repository::Grid grid = repository::makeGrid(base::Aabb{{-1, -1, 0}, {1, 1, 0}}, 2, 0.5F, 32);
  std::size_t seen = 0;
  const FaceOrder order(grid);
  for (std::uint64_t n = 0; n < order.count(); ++n)
    seen += showsModel(renderer_->render(faceCameras(*renderer_, grid, {order.face(n)}).front(), {})->rgba) ? 1U : 0U;
  ASSERT_GT(seen, 0U);
  EXPECT_EQ(sampleFaces(*renderer_, grid, {}, 1000)->size(), seen);

  repository::Grid far_away = grid;
  far_away.first += glm::vec3(0.0F, 0.0F, 1e6F);
  far_away.face_size = 16;  // half a millionth of a radian is no pixel
  EXPECT_TRUE(sampleFaces(*renderer_, far_away, {}, 4)->empty());
}

}  // namespace
}  // namespace server
