#include "server/bake/bake.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/egl/headless.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/verify.h"
#include "server/bake/adaptive.h"
#include "server/bake/cell_judge.h"
#include "server/bake/demand.h"
#include "tests/server/bake/memory_store.h"
#include "tests/server/bake/sphere.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

using test::sphere;

class BakeTest : public testing::Test {
 protected:
  BakeTest() : scene_(sphere(6, -1.0F, 1.0F), {sphere(8, -1.0F, 0.0F), sphere(8, 0.0F, 1.0F)}, 0.1F) {
    scene_.scene().box_min = glm::dvec3(-1.0);
    scene_.scene().box_max = glm::dvec3(1.0);
    scene_.scene().parts = {{"patch.lgp", 1, "abc"}};
    options_.grid = repository::makeGrid(scene_.scene().localBox(), 3, 0.5F, 64);
    options_.batch_faces = 10;
    options_.threads = 3;
  }
  base::Result<BakeSummary> run(
      repository::Store& store,
      const std::function<bool(const BakeProgress&)>& progress = [](const BakeProgress&) { return true; }) {
    return bake(scene_.scene(), scene_.file(), store, options_, progress);
  }

  test::TwoLevelScene scene_;
  BakeOptions options_;
};

TEST_F(BakeTest, processesOfTheirOwnStoreTheSameBytes) {
  MemoryStore here, in_processes;
  ASSERT_TRUE(run(here));
  options_.draw_command = {DRAW_PROCESS};
  const auto summary = run(in_processes);
  ASSERT_TRUE(summary) << summary.error().message;
  EXPECT_EQ(summary->faces_rendered, 27U * 6U);
  EXPECT_EQ(in_processes.values, here.values);
}

TEST_F(BakeTest, everyFaceOfTheGridIsStoredAndVerifies) {
  const support::TemporaryDirectory directory;
  const auto store = std::move(*repository::openLmdbStore(directory / "images", repository::StoreMode::kWrite));
  const auto summary = run(*store);
  ASSERT_TRUE(summary) << summary.error().message;
  EXPECT_EQ(summary->faces_rendered, 27U * 6U);
  EXPECT_EQ(*store->size(), 27U * 6U);
  EXPECT_TRUE(repository::verify(*store, options_.grid)->empty());
  const repository::StoreContents contents = *repository::contentsOf(*store);
  EXPECT_EQ(contents.empty, summary->faces_empty);
  EXPECT_EQ(contents.jpeg_bytes, summary->jpeg_bytes);
  EXPECT_EQ(contents.coverage_bytes, summary->coverage_bytes);
}

// The grid's corner (0, 0, 0) lies at (−2, −2, −2): the sphere is seen in +x, +y and +z, and nothing in the other
// three.
TEST_F(BakeTest, facesThatLookAwayAreEmptyFlagsAndTheOthersShowTheModel) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  for (std::uint32_t d = 0; d < 6; ++d) {
    const auto value = repository::decodeFaceValue(store.values[FaceKey{0, 0, 0, d}]);
    ASSERT_TRUE(value);
    EXPECT_EQ(value->empty, d % 2 == 1) << d;
  }
  // From (2, 0, 0) − the face towards the middle − the sphere is a disc around the centre of the picture: sin = 1/2, so
  // its radius is tan 30° of the half side: 32 × 0.577 = 18.5 pixels.
  const auto value = repository::decodeFaceValue(store.values[FaceKey{2, 1, 1, 1}]);
  ASSERT_TRUE(value && !value->empty);
  const auto mask = repository::decodeCoverage(value->coverage, 64, 64);
  ASSERT_TRUE(mask);
  int wrong = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const double radius = std::hypot(x + 0.5 - 32.0, y + 0.5 - 32.0);
      if (radius < 16.5 || radius > 20.0) wrong += (*mask->at(x, y) != 0) != (radius < 18.0) ? 1 : 0;
    }
  }
  EXPECT_EQ(wrong, 0);
}

TEST_F(BakeTest, batchesAreInMortonOrderAndOfTheSizeAsked) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  std::vector<FaceKey> keys;
  for (const auto& batch : store.batches) {
    EXPECT_LE(batch.size(), 10U);
    keys.insert(keys.end(), batch.begin(), batch.end());
  }
  EXPECT_EQ(keys.size(), 27U * 6U);
  EXPECT_TRUE(std::is_sorted(keys.begin(), keys.end()));
  EXPECT_EQ(store.batches.size(), 17U);
}

TEST_F(BakeTest, shardsTogetherAreTheWholeValueByValue) {
  MemoryStore whole;
  ASSERT_TRUE(run(whole));
  std::map<FaceKey, base::Bytes> together;
  for (std::uint32_t i = 0; i < 4; ++i) {
    options_.shard = {i, 4};
    MemoryStore store;
    const auto summary = run(store);
    ASSERT_TRUE(summary);
    EXPECT_EQ(summary->faces_rendered, 6 * repository::pointsOf(options_.shard, options_.grid).size());
    EXPECT_EQ(store.values.size(), summary->faces_rendered);
    EXPECT_EQ(store.meta, whole.meta);
    EXPECT_EQ(run(store)->faces_rendered, 0U);
    together.insert(store.values.begin(), store.values.end());
  }
  EXPECT_EQ(together, whole.values);
}

TEST_F(BakeTest, whatIsFaultyIsRenderedAgainAndOrphansGo) {
  MemoryStore store;
  options_.shard = {1, 2};
  ASSERT_TRUE(run(store));
  const auto whole = store.values;
  const FaceKey first = store.values.begin()->first;
  const FaceKey last = store.values.rbegin()->first;
  store.values[first].back() ^= 1;
  store.values[last] = repository::encodeFaceValue({false, base::Bytes{1, 2, 3}, {}});  // its checksum is right
  store.values[{0, 0, 0, 0}] = repository::encodeFaceValue({});                         // of shard 0
  store.values[{9, 9, 9, 0}] = repository::encodeFaceValue({});
  const auto removed = repository::removeFaulty(store, options_.grid, options_.shard, nullptr, 2);
  ASSERT_TRUE(removed);
  EXPECT_EQ(removed->damaged, 2U);
  EXPECT_EQ(removed->orphans, 2U);
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_rendered, 2U);
  EXPECT_EQ(store.values, whole);
}

TEST_F(BakeTest, aCancelledBakeGoesOnToTheSameBytesWithOtherThreads) {
  MemoryStore whole;
  ASSERT_TRUE(run(whole));

  MemoryStore store;
  int calls = 0;
  const auto cancelled = run(store, [&](const BakeProgress&) { return ++calls < 7; });
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, base::ErrorCode::kCancelled);
  const std::size_t before = store.values.size();
  EXPECT_GT(before, 0U);
  EXPECT_LT(before, whole.values.size());

  options_.threads = 1;
  options_.batch_faces = 7;
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_skipped, before);
  EXPECT_EQ(summary->faces_rendered, whole.values.size() - before);
  EXPECT_EQ(store.values, whole.values);
}

TEST_F(BakeTest, onlyMissingAndDamagedFacesAreRenderedAgain) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const auto whole = store.values;
  store.values.erase({1, 1, 2, 4});
  store.values[{0, 1, 2, 3}].back() ^= 1;
  store.values[{2, 2, 2, 0}].resize(3);
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_rendered, 3U);
  EXPECT_EQ(store.values, whole);
}

TEST_F(BakeTest, aWholeStoreIsLeftAlone) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  store.batches.clear();
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_rendered, 0U);
  EXPECT_EQ(summary->faces_skipped, 27U * 6U);
  EXPECT_TRUE(store.batches.empty());
}

TEST_F(BakeTest, otherParametersAreRefusedByName) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const BakeOptions good = options_;
  std::vector<std::pair<BakeOptions, std::string>> others(5, {good, ""});
  others[0].first.quality = 70, others[0].second = "quality";
  others[1].first.subsampling = repository::Subsampling::k444, others[1].second = "subsampling";
  others[2].first.tolerance_px = 2.0F, others[2].second = "tolerance";
  others[3].first.supersampling = 1, others[3].second = "supersampling";
  others[4].first.grid = repository::makeGrid(scene_.scene().localBox(), 4, 0.5F, 64), others[4].second = "grid";
  for (const auto& [options, name] : others) {
    options_ = options;
    const auto refused = run(store);
    ASSERT_FALSE(refused) << name;
    EXPECT_EQ(refused.error().code, base::ErrorCode::kExists);
    EXPECT_NE(refused.error().message.find(name), std::string::npos) << refused.error().message;
    EXPECT_NE(refused.error().message.find("--force"), std::string::npos);
  }
  options_ = good;
  scene_.scene().parts[0].sha256 = "another hierarchy";
  EXPECT_FALSE(run(store));
}

TEST_F(BakeTest, facesOfUnknownParametersAreRefused) {
  MemoryStore store;
  store.values[{0, 0, 0, 0}] = repository::encodeFaceValue({});
  const auto refused = run(store);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, base::ErrorCode::kExists);
}

TEST_F(BakeTest, aFullStoreEndsTheBakeWithItsErrorAndKeepsWhatIsCommitted) {
  MemoryStore store;
  store.fail_at_batch = 2;
  const auto failed = run(store);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, base::ErrorCode::kNoSpace);
  EXPECT_EQ(store.values.size(), 20U);
  store.fail_at_batch = ~std::size_t{0};
  ASSERT_TRUE(run(store));
  EXPECT_EQ(store.values.size(), 27U * 6U);
}

TEST_F(BakeTest, progressCountsUpToTheWhole) {
  MemoryStore store;
  std::vector<BakeProgress> seen;
  ASSERT_TRUE(run(store, [&](const BakeProgress& progress) {
    seen.push_back(progress);
    return true;
  }));
  EXPECT_EQ(seen.front().faces_done, 0U);
  EXPECT_EQ(seen.back().faces_done, 27U * 6U);
  EXPECT_EQ(seen.back().faces_total, 27U * 6U);
  EXPECT_EQ(seen.back().seconds_left, 0.0);
  EXPECT_GT(seen.back().faces_per_second, 0.0);
  for (std::size_t i = 1; i < seen.size(); ++i) EXPECT_LE(seen[i - 1].faces_done, seen[i].faces_done);
  std::uint64_t bytes = 0;
  for (const auto& [key, value] : store.values) bytes += value.size();
  EXPECT_EQ(seen.back().stored_bytes, bytes);
}

TEST_F(BakeTest, optionsThatMakeNoSenseAreErrors) {
  const BakeOptions good = options_;
  std::vector<BakeOptions> bad(11, good);
  bad[0].quality = 0;
  bad[1].grid = {};
  bad[2].grid.face_size = 0;
  bad[3].batch_faces = 0;
  bad[4].grid.count = glm::uvec3(1 << 12);
  bad[5].shard = {4, 4};
  bad[6].shard = {0, 0};
  bad[7].shard = {0, 2};
  bad[7].target_db = 30.0;
  bad[8].demand_views = 10;
  bad[8].target_db = 30.0;
  bad[9].demand_views = 10;
  bad[9].demand_worth = 0.0;
  bad[10].demand_views = 10;
  bad[10].shard = {0, 2};
  for (const BakeOptions& options : bad) {
    options_ = options;
    MemoryStore store;
    const auto refused = run(store);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_FALSE(store.meta.has_value());
  }
}

// A sphere with soft stripes on one half, whose coarse cut is grey and says that it is nearly exact: clients take it
// for a proxy, and the stripes are in the images alone.
constexpr double kMiddle = 26.0;

class AdaptiveBakeTest : public BakeTest {
 protected:
  AdaptiveBakeTest()
      : scene_(striped(12, -1.0F, 1.0F, false), {striped(24, -1.0F, 0.0F, true), striped(24, 0.0F, 1.0F, true)},
               1e-4F) {
    scene_.scene().box_min = glm::dvec3(-1.0);
    scene_.scene().box_max = glm::dvec3(1.0);
    scene_.scene().parts = {{"patch.lgp", 1, "abc"}};
    options_.grid = repository::makeGrid(scene_.scene().localBox(), 5, 0.5F, 96);
    options_.tolerance_px = 0.0F;
    options_.quality = 95;
    options_.target_db = 30.0;
    options_.coarse_cells = 2;
  }
  static std::vector<test::Triangle> striped(int rings, float from_z, float to_z, bool stripes) {
    auto triangles = sphere(rings, from_z, to_z);
    for (test::Triangle& t : triangles) {
      const float x = (t.a.x + t.b.x + t.c.x) / 3.0F;
      const float wave = stripes && x > 0.0F ? 60.0F * std::sin(5.0F * x) : 0.0F;
      t.color =
          glm::u8vec4(static_cast<std::uint8_t>(150.0F + wave), 150, static_cast<std::uint8_t>(150.0F - wave), 255);
    }
    return triangles;
  }
  base::Result<BakeSummary> run(
      repository::Store& store,
      const std::function<bool(const BakeProgress&)>& progress = [](const BakeProgress&) { return true; }) {
    return bake(scene_.scene(), scene_.file(), store, options_, progress);
  }
  test::TwoLevelScene scene_;
  repository::SampleTree treeOf(const MemoryStore& store) {
    auto tree = repository::treeFromText(store.meta.value_or(""), options_.grid, "store");
    EXPECT_TRUE(tree && *tree);
    return tree && *tree ? std::move(**tree) : repository::SampleTree(options_.grid, 8);
  }
};

TEST_F(AdaptiveBakeTest, theHigherTheTargetTheMorePointsAndAllOfThemAreStored) {
  options_.grid = repository::makeGrid(scene_.scene().localBox(), 9, 0.5F, 48);
  options_.least_gain_db = -99.0;
  std::vector<std::uint64_t> points;
  for (const double target : {5.0, kMiddle, 60.0}) {
    options_.target_db = target;
    MemoryStore store;
    const auto summary = run(store);
    ASSERT_TRUE(summary) << summary.error().message;
    const repository::SampleTree tree = treeOf(store);
    EXPECT_EQ(summary->points, tree.points().size());
    EXPECT_EQ(store.values.size(), 6 * tree.points().size());
    EXPECT_TRUE(repository::verify(store, options_.grid, &tree)->empty());
    EXPECT_TRUE(tree.openLeaves().empty());
    points.push_back(summary->points);
    // Cells of four steps are judged, then those of two; those of one step cannot be split.
    ASSERT_FALSE(summary->growth.empty());
    EXPECT_EQ(summary->growth.front().cell, 4U);
    EXPECT_EQ(summary->growth.front().cells, 8U);
    if (summary->growth.size() > 1) {
      EXPECT_GT(summary->growth[1].psnr_db, summary->growth[0].psnr_db);
    }
  }
  EXPECT_EQ(points.front(), 26U);  // the middle of 27 lies within the sphere
  EXPECT_LT(points[0], points[1]);
  EXPECT_LT(points[1], points[2]);
  // 60 dB is reached nowhere: the whole grid, but for what the sphere encloses.
  std::uint64_t outside = 0;
  for (const glm::uvec3& p : repository::pointsInMortonOrder(options_.grid))
    outside += glm::length(options_.grid.point(p.x, p.y, p.z)) > 0.95F ? 1 : 0;
  EXPECT_EQ(points[2], outside);
}

// ---- points in demand ----

class DemandBakeTest : public AdaptiveBakeTest {
 protected:
  DemandBakeTest() {
    options_.grid = repository::makeGrid(scene_.scene().localBox(), 9, 0.5F, 48);
    options_.target_db = 0.0;
    options_.demand_views = 60;
  }
  std::uint64_t pointsOutside() const {
    std::uint64_t outside = 0;
    for (const glm::uvec3& p : repository::pointsInMortonOrder(options_.grid))
      outside += glm::length(options_.grid.point(p.x, p.y, p.z)) > 0.95F ? 1 : 0;
    return outside;
  }
};

TEST_F(DemandBakeTest, onlyPointsThatViewsChooseAreStoredAndThoseWhole) {
  MemoryStore store;
  const auto summary = run(store);
  ASSERT_TRUE(summary) << summary.error().message;
  const repository::SampleTree tree = treeOf(store);
  EXPECT_EQ(summary->points, tree.points().size());
  EXPECT_GE(summary->points, 8U);
  EXPECT_LT(summary->points, pointsOutside() / 2);
  EXPECT_EQ(store.values.size(), 6 * tree.points().size());
  EXPECT_TRUE(tree.openLeaves().empty());
  EXPECT_TRUE(repository::verify(store, options_.grid, &tree)->empty());
  for (const glm::uvec3& p : tree.points())
    EXPECT_GT(glm::length(options_.grid.point(p.x, p.y, p.z)), 0.95F) << "nobody looks from within";

  // A second run has nothing to do; one that was killed goes on with the tree that it chose.
  const auto again = run(store);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->faces_rendered, 0U);
  store.values.erase(store.values.begin());
  const auto repaired = run(store);
  ASSERT_TRUE(repaired);
  EXPECT_EQ(repaired->faces_rendered, 1U);
  EXPECT_EQ(repaired->points, summary->points);
}

TEST_F(DemandBakeTest, theMoreIsToBeKeptTheMorePointsThereAre) {
  std::size_t before = 0;
  for (const double worth : {0.6, 0.9, 1.0}) {
    const auto tree = treeInDemand(scene_.scene(), scene_.file(), options_.grid, {60, worth, 2});
    ASSERT_TRUE(tree) << tree.error().message;
    EXPECT_GT(tree->points().size(), before) << worth;
    before = tree->points().size();
  }
}

TEST_F(DemandBakeTest, theSameTreeWithAnyNumberOfThreads) {
  const auto one = treeInDemand(scene_.scene(), scene_.file(), options_.grid, {40, 0.9, 1});
  const auto many = treeInDemand(scene_.scene(), scene_.file(), options_.grid, {40, 0.9, 4});
  ASSERT_TRUE(one && many);
  EXPECT_EQ(one->encode(), many->encode());
}

TEST_F(DemandBakeTest, whoeverStopsItIsToldSo) {
  const auto stopped =
      treeInDemand(scene_.scene(), scene_.file(), options_.grid, {40, 0.5, 2}, [](double) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
}

TEST_F(DemandBakeTest, withoutAViewOfTheModelThereIsNothingToChoose) {
  const auto none = treeInDemand(scene_.scene(), scene_.file(), options_.grid, {0, 0.9, 1});
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, base::ErrorCode::kInvalidInput);
}

TEST_F(AdaptiveBakeTest, noCellIsSplitWhereThatGainsNothing) {
  options_.target_db = 60.0;
  options_.least_gain_db = 50.0;
  MemoryStore store;
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->points, 26U);
  EXPECT_EQ(summary->growth.back().split, 0U);
}

// Somebody has been at one corner of the viewing space.
TEST_F(AdaptiveBakeTest, onlyWhereViewersComeAreCellsSplit) {
  options_.target_db = 60.0;
  options_.least_gain_db = -99.0;
  const glm::vec3 corner = options_.grid.first;
  options_.use = [&](const glm::vec3& low, const glm::vec3& high) {
    return glm::all(glm::lessThanEqual(low, corner)) && glm::all(glm::greaterThanEqual(high, corner)) ? 1.0 : 0.0;
  };
  MemoryStore store;
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  const repository::SampleTree tree = treeOf(store);
  EXPECT_EQ(summary->growth.back().split, 1U);
  EXPECT_EQ(tree.leafOf({0, 0, 0}).size, 1U);
  EXPECT_EQ(tree.leafOf({3, 3, 3}).size, 2U);
  EXPECT_TRUE(tree.openLeaves().empty());
}

TEST_F(AdaptiveBakeTest, aBudgetEndsTheSplitting) {
  options_.target_db = 60.0;
  options_.least_gain_db = -99.0;
  MemoryStore all;
  const auto whole = run(all);
  ASSERT_TRUE(whole);
  const auto bytesOf = [](const MemoryStore& store) {
    std::uint64_t bytes = 0;
    for (const auto& [key, value] : store.values) bytes += value.size();
    return bytes;
  };
  options_.budget_bytes = bytesOf(all) / 2;
  MemoryStore half;
  const auto some = run(half);
  ASSERT_TRUE(some);
  EXPECT_LT(some->points, whole->points);
  EXPECT_GT(some->points, 26U);
  // A cell is split while there is room, so that the last one may be too much by its own points.
  EXPECT_LT(bytesOf(half), bytesOf(all) * 8 / 10);
  options_.budget_bytes = 1;
  MemoryStore none;
  EXPECT_EQ(run(none)->points, 26U);
}

TEST_F(AdaptiveBakeTest, stoppedAtAnyMomentItEndsWithTheSameTreeAndBytes) {
  options_.target_db = kMiddle;
  MemoryStore whole;
  int steps = 0;
  ASSERT_TRUE(run(whole, [&](const BakeProgress&) { return ++steps, true; }));
  for (const int stop : {1, 5, steps / 3, steps / 2, 3 * steps / 4, steps - 1}) {
    MemoryStore store;
    int calls = 0;
    const auto stopped = run(store, [&](const BakeProgress&) { return ++calls < stop; });
    if (!stopped) {
      EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
    }
    const auto summary = run(store);
    ASSERT_TRUE(summary) << stop;
    EXPECT_EQ(store.values, whole.values) << stop;
    EXPECT_EQ(treeOf(store).encode(), treeOf(whole).encode()) << stop;
    // Nothing is left to do.
    const auto again = run(store);
    ASSERT_TRUE(again);
    EXPECT_EQ(again->faces_rendered, 0U);
    EXPECT_EQ(again->points, summary->points);
    EXPECT_EQ(again->growth.size(), summary->growth.size());
  }
}

TEST_F(AdaptiveBakeTest, anotherTargetAndAPlainGridAreRefused) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  for (const double target : {0.0, 31.0}) {
    options_.target_db = target;
    const auto refused = run(store);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kExists);
    EXPECT_NE(refused.error().message.find("target"), std::string::npos) << refused.error().message;
  }
}

TEST_F(AdaptiveBakeTest, aDamagedFaceIsRenderedAgain) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const auto whole = store.values;
  store.values.begin()->second.back() ^= 1;
  store.values.erase(std::prev(store.values.end())->first);
  const auto summary = run(store);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->faces_rendered, 2U);
  EXPECT_EQ(store.values, whole);
}

// What the judge says of views is what it should be: good at a sampling point, worse half-way, worse without images.
TEST_F(AdaptiveBakeTest, aViewFromASamplingPointIsNearlyTheTruth) {
  options_.target_db = 5.0;
  MemoryStore store;
  ASSERT_TRUE(run(store));
  auto context = base::HeadlessContext::create();
  ASSERT_TRUE(context);
  auto renderer = SceneRenderer::create(scene_.scene(), scene_.file());
  ASSERT_TRUE(renderer);
  JudgeOptions options;
  options.truth.tolerance_px = options_.tolerance_px;
  options.view_size = 96;
  auto judge = CellJudge::create(scene_.scene(), scene_.file(), store, options_.grid, options);
  ASSERT_TRUE(judge);
  const std::vector<glm::uvec3> points = treeOf(store).points();
  const auto psnr = [&](const glm::vec3& eye, std::span<const glm::uvec3> of) {
    const auto error = (*judge)->judge(**renderer, eye, of);
    EXPECT_TRUE(error) << error.error().message;
    return error ? error->psnr() : 0.0;
  };
  const glm::vec3 point = options_.grid.point(4, 2, 2);
  const double at_point = psnr(point, points);
  const double between = psnr(0.5F * (options_.grid.point(4, 2, 2) + options_.grid.point(4, 0, 2)), points);
  EXPECT_GT(at_point, between + 1.0);
  EXPECT_GT(psnr(point, points), psnr(point, {}));
  EXPECT_EQ(psnr(glm::vec3(0.0F, 0.0F, 400.0F), {}), psnr(glm::vec3(0.0F, 0.0F, 400.0F), {}));
}

}  // namespace
}  // namespace server
