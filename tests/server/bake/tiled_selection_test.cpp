#include <gtest/gtest.h>

#include <map>
#include <memory>

#include "repository/faces/face_value.h"
#include "repository/verify.h"
#include "server/bake/bake.h"
#include "server/bake/point_selection.h"
#include "tests/server/bake/memory_store.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/scratch_directory.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

// A statue with more colours than its patches show from afar.
class TiledSelectionTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    mesh::generate::SampleOptions sample;
    sample.triangles = 60'000;
    directory_ = std::make_unique<support::ScratchDirectory>("lumigrid_TiledSelection");
    const auto made = support::makeScene(support::makeSample(sample), directory_->path());
    ASSERT_TRUE(made) << made.error().message;
    scene_ = *made;
  }
  static void TearDownTestSuite() { directory_.reset(); }

  TiledSelectionTest() : patches_(std::move(*lod::patch::PatchFile::open(*directory_ / "patch.lgp"))) {
    options_.grid = repository::withTiles(repository::makeGrid(scene_.localBox(), 4, 0.5F, 64), 2);
    options_.selection.views = 40;
    options_.limits.threads = 2;
  }
  base::Result<Selection> select() { return selectImages(scene_, patches_, options_); }
  void mustSelect() {
    auto selection = select();
    ASSERT_TRUE(selection) << selection.error().message;
    ASSERT_TRUE(selection->tiles);
    options_.points = std::move(selection->points);
    options_.tiles = std::move(selection->tiles);
  }
  base::Result<BakeSummary> run(repository::Store& store) {
    return bake(scene_, patches_, store, options_, [](const BakeProgress&) { return true; });
  }
  static std::uint64_t bytesOf(const MemoryStore& store) {
    std::uint64_t bytes = 0;
    for (const auto& [key, value] : store.values) bytes += value.size();
    return bytes;
  }

  static inline std::unique_ptr<support::ScratchDirectory> directory_;
  static inline base::Scene scene_;
  lod::patch::PatchFile patches_;
  BakeOptions options_;
};

TEST_F(TiledSelectionTest, onlyTilesThatViewsUseAreStored) {
  mustSelect();
  MemoryStore store;
  ASSERT_TRUE(run(store));
  EXPECT_TRUE(repository::verify(store, options_.grid, &*options_.points)->empty());
  std::size_t deeper = 0;
  for (const auto& [key, value] : store.values) {
    EXPECT_TRUE(options_.tiles->has(key)) << repository::nameOf(key);
    deeper += key.tile != 0 ? 1 : 0;
  }
  EXPECT_GT(deeper, 0U);
  EXPECT_LE(deeper, options_.tiles->count());

  // A second run has nothing to do; one that lost a tile draws its face again.
  const std::map<FaceKey, base::Bytes> before = store.values;
  EXPECT_EQ(run(store)->faces_rendered, 0U);
  store.values.erase(std::prev(store.values.end()));
  EXPECT_EQ(run(store)->faces_rendered, 1U);
  EXPECT_EQ(store.values, before);

  options_.draw_command = {DRAW_PROCESS};
  MemoryStore in_processes;
  ASSERT_TRUE(run(in_processes));
  EXPECT_EQ(in_processes.values, before);

  options_.tiles.reset();
  MemoryStore whole;
  ASSERT_TRUE(run(whole));
  EXPECT_LT(bytesOf(store), bytesOf(whole));
  const auto mixed = run(store);
  ASSERT_FALSE(mixed);
  EXPECT_EQ(mixed.error().code, base::ErrorCode::kExists);
}

TEST_F(TiledSelectionTest, theMoreIsToBeKeptTheMoreTilesThereAre) {
  std::size_t before = 0;
  for (const double worth : {0.5, 0.8, 1.0}) {
    options_.selection.worth = worth;
    mustSelect();
    EXPECT_GT(options_.tiles->count(), before) << worth;
    before = options_.tiles->count();
  }
}

TEST_F(TiledSelectionTest, isTheSameWithAnyNumberOfThreadsAndComesBackFromItsFile) {
  mustSelect();
  const BakeOptions with_two = options_;
  options_.limits.threads = 1;
  mustSelect();
  EXPECT_EQ(*options_.tiles, *with_two.tiles);
  EXPECT_EQ(options_.points->encode(), with_two.points->encode());

  const std::string path = *directory_ / "points.json";
  ASSERT_TRUE(writeSelection(path, scene_, options_));
  const auto back = readSelection(path, scene_, options_);
  ASSERT_TRUE(back && *back);
  EXPECT_EQ(*(*back)->tiles, *options_.tiles);
  EXPECT_EQ((*back)->points.encode(), options_.points->encode());
}

TEST_F(TiledSelectionTest, theImagesFitIntoTheBudget) {
  mustSelect();
  MemoryStore whole;
  ASSERT_TRUE(run(whole));
  const std::uint64_t all = bytesOf(whole);
  for (const std::uint64_t budget : {2 * all, all / 2, all / 4}) {
    options_.selection.budget_bytes = budget;
    mustSelect();
    MemoryStore store;
    ASSERT_TRUE(run(store));
    // The bytes of sixteen points tell those of all: two standard errors more are counted, and seldom too few.
    EXPECT_LE(bytesOf(store), budget + budget / 100);
    EXPECT_GT(bytesOf(store), std::min(budget, all) / 2) << "no more is left out than must be";
  }
  options_.selection.budget_bytes = 100;
  const auto none = select();
  ASSERT_FALSE(none);
  EXPECT_NE(none.error().message.find("--budget"), std::string::npos) << none.error().message;
}

}  // namespace
}  // namespace server
