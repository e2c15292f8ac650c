#include <gtest/gtest.h>

#include "base/egl/headless.h"
#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/cube_face.h"
#include "repository/verify.h"
#include "server/bake/bake.h"
#include "server/bake/face_sample.h"
#include "server/bake/tune.h"
#include "tests/server/bake/memory_store.h"
#include "tests/server/bake/sphere_bake.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

class TiledBakeTest : public test::SphereBake {
 protected:
  TiledBakeTest() : SphereBake(2) {
    options_.grid = repository::withTiles(options_.grid, 2);
    options_.batch_faces = 30;
    options_.limits.threads = 2;
  }
};

TEST_F(TiledBakeTest, facesAreStoredAsTilesAndCountedByDepth) {
  MemoryStore store;
  const auto summary = run(store);
  ASSERT_TRUE(summary) << summary.error().message;
  EXPECT_EQ(summary->faces_rendered, 8U * 6U);
  EXPECT_EQ(summary->by_depth[0].tiles, 8U * 6U);
  EXPECT_GT(summary->by_depth[2].tiles, summary->by_depth[1].tiles);
  EXPECT_LT(summary->by_depth[2].tiles, 16 * 24U) << "half of the faces see nothing";
  EXPECT_EQ(summary->by_depth[3].tiles, 0U);
  TileCounts counts{};
  for (const auto& [key, value] : store.values) {
    TileCount& count = counts[repository::placeOfTile(key.tile).depth];
    ++count.tiles;
    count.bytes += value.size();
  }
  for (std::size_t depth = 0; depth < counts.size(); ++depth) {
    EXPECT_EQ(summary->by_depth[depth].tiles, counts[depth].tiles) << depth;
    EXPECT_EQ(summary->by_depth[depth].bytes, counts[depth].bytes) << depth;
  }
}

// The tile's own camera and the cut through the face's picture agree: where they did not, the sphere would be beside
// itself by a tile.
TEST_F(TiledBakeTest, aTileShowsWhatItsOwnCameraSees) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const auto context = std::move(*base::HeadlessContext::create());
  const auto renderer = std::move(*SceneRenderer::create(scene_.scene(), scene_.file()));
  const base::Sphere bounds{renderer->sceneCenter(), renderer->sceneRadius()};
  std::array<int, 3> compared{};
  for (const auto& [key, value] : store.values) {
    if (key.x != 0 || repository::decodeFaceValue(value)->empty) continue;
    const auto tile = repository::decodeFacePixels(value, 256);
    ASSERT_TRUE(tile) << repository::nameOf(key);
    const auto drawn = renderer->render(repository::faceCamera(options_.grid, key, bounds), renderOptions(options_));
    ASSERT_TRUE(drawn);
    int differing = 0;
    for (int y = 0; y < 256; ++y)
      for (int x = 0; x < 256; ++x)
        differing += (*tile->mask.at(x, y) != 0) != (drawn->rgba.at(x, y)[3] >= kStoredCoverage) ? 1 : 0;
    EXPECT_LT(differing, 256) << repository::nameOf(key);
    ++compared[repository::placeOfTile(key.tile).depth];
  }
  for (const int count : compared) EXPECT_GT(count, 0);
}

TEST_F(TiledBakeTest, processesOfTheirOwnStoreTheSameBytes) {
  MemoryStore here, in_processes;
  ASSERT_TRUE(run(here));
  options_.draw_command = {DRAW_PROCESS};
  ASSERT_TRUE(run(in_processes));
  EXPECT_EQ(in_processes.values, here.values);
}

TEST_F(TiledBakeTest, everyCommitHoldsWholeFaces) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  EXPECT_EQ(facesPerCommit(options_), 7U);  // 30 / 4
  EXPECT_EQ(store.batches.size(), 7U);      // 48 faces
  std::optional<FaceKey> last;
  for (const auto& batch : store.batches) {
    ASSERT_FALSE(batch.empty());
    EXPECT_EQ(batch.front().tile, 0U);
    if (last) {
      EXPECT_NE(batch.front().face(), last->face());
    }
    last = batch.back();
  }
}

TEST_F(TiledBakeTest, aCancelledBakeGoesOnToTheSameBytes) {
  MemoryStore whole;
  ASSERT_TRUE(run(whole));
  MemoryStore store;
  store.fail_at_batch = 3;
  ASSERT_FALSE(run(store));
  EXPECT_LT(store.values.size(), whole.values.size());
  store.fail_at_batch = ~std::size_t{0};
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_skipped, 21U);
  EXPECT_EQ(summary->faces_rendered, 27U);
  EXPECT_EQ(store.values, whole.values);
}

TEST_F(TiledBakeTest, aFaceThatLacksATileIsDrawnAgain) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const auto whole = store.values;
  std::vector<FaceKey> finest;
  for (const auto& [key, value] : whole)
    if (repository::placeOfTile(key.tile).depth == 2) finest.push_back(key);
  ASSERT_GT(finest.size(), 2U);
  ASSERT_NE(finest.front().face(), finest.back().face());
  store.values.erase(finest.front());
  store.values[finest.back()].back() ^= 1;
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_rendered, 2U);
  EXPECT_EQ(store.values, whole);
}

TEST_F(TiledBakeTest, anotherDepthIsRefused) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  options_.grid = repository::withTiles(options_.grid, 1);
  const auto refused = run(store);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, base::ErrorCode::kExists);
  EXPECT_NE(refused.error().message.find("grid"), std::string::npos) << refused.error().message;
}

TEST_F(TiledBakeTest, qualityIsTunedOnTiles) {
  const auto choice = tuneScene(scene_.scene(), scene_.file(), options_, 30.0);
  ASSERT_TRUE(choice) << choice.error().message;
  EXPECT_GE(choice->psnr_db, 30.0);
  EXPECT_GT(choice->faces, 24U) << "more images than there are faces that show anything";
}

}  // namespace
}  // namespace server
