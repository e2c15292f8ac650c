#include "server/bake/bake.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/verify.h"
#include "server/bake/point_selection.h"
#include "tests/server/bake/memory_store.h"
#include "tests/server/bake/sphere_bake.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

class BakeTest : public test::SphereBake {
 protected:
  BakeTest() : SphereBake(3) {
    options_.batch_faces = 10;
    options_.limits.threads = 3;
  }
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

// The grid's corner (0, 0, 0) lies at (−2, −2, −2), so the sphere is seen in +x, +y and +z, and nothing in the other
// three directions.
TEST_F(BakeTest, facesThatLookAwayAreEmptyFlagsAndTheOthersShowTheModel) {
  MemoryStore store;
  ASSERT_TRUE(run(store));
  for (std::uint32_t d = 0; d < 6; ++d) {
    const auto value = repository::decodeFaceValue(store.values[FaceKey{0, 0, 0, d}]);
    ASSERT_TRUE(value);
    EXPECT_EQ(value->empty, d % 2 == 1) << d;
  }
  // In the face at (2, 0, 0) towards the middle the sphere is a disc around the centre of the picture. The sine of its
  // angle is 1/2, so its radius is tan 30° of the half side: 32 × 0.577 = 18.5 pixels.
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

TEST_F(BakeTest, rendersFaultyFacesAgainAndRemovesOrphans) {
  MemoryStore store;
  options_.shard = {1, 2};
  ASSERT_TRUE(run(store));
  const auto whole = store.values;
  const FaceKey first = store.values.begin()->first;
  const FaceKey last = store.values.rbegin()->first;
  store.values[first].back() ^= 1;
  store.values[last] = repository::encodeFaceValue({false, base::Bytes{1, 2, 3}, {}});  // its checksum is right
  store.values[{0, 0, 0, 0}] = repository::encodeFaceValue({});                         // belongs to shard 0
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

  options_.limits.threads = 1;
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
  others[1].first.subsampling = base::Subsampling::k444, others[1].second = "subsampling";
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
  EXPECT_GT(seen.back().faces_per_second, 0.0);
  for (std::size_t i = 1; i < seen.size(); ++i) EXPECT_LE(seen[i - 1].faces_done, seen[i].faces_done);
  std::uint64_t bytes = 0;
  for (const auto& [key, value] : store.values) bytes += value.size();
  EXPECT_EQ(seen.back().stored_bytes, bytes);
}

TEST_F(BakeTest, optionsThatMakeNoSenseAreErrors) {
  const BakeOptions good = options_;
  std::vector<BakeOptions> bad(9, good);
  bad[0].quality = 0;
  bad[1].grid = {};
  bad[2].grid.face_size = 0;
  bad[3].batch_faces = 0;
  bad[4].grid.count = glm::uvec3(1 << 12);
  bad[5].shard = {4, 4};
  bad[6].shard = {0, 0};
  bad[7].selection.views = 10;  // without points
  bad[8].selection.worth = 0.0;
  for (const BakeOptions& options : bad) {
    options_ = options;
    MemoryStore store;
    const auto refused = run(store);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_FALSE(store.meta.has_value());
  }
}

// ---- selected points ----

class SelectionTest : public BakeTest {
 protected:
  SelectionTest() {
    options_.grid = repository::makeGrid(scene_.scene().localBox(), 9, 0.5F, 48);
    options_.selection.views = 60;
  }
  base::Result<Selection> select(
      const ViewerPlaces* places = nullptr, const std::function<bool(double)>& progress = [](double) { return true; }) {
    return selectImages(scene_.scene(), scene_.file(), options_, places, progress);
  }
  void mustSelect() {
    auto selection = select();
    ASSERT_TRUE(selection) << selection.error().message;
    options_.points = std::move(selection->points);
    options_.tiles = std::move(selection->tiles);
  }
  std::uint64_t pointsOutside() const {
    std::uint64_t outside = 0;
    for (const glm::uvec3& p : repository::pointsInMortonOrder(options_.grid))
      outside += glm::length(options_.grid.point(p.x, p.y, p.z)) > 0.95F ? 1 : 0;
    return outside;
  }
};

TEST_F(SelectionTest, onlyPointsThatViewsChooseAreStoredAndThoseWhole) {
  mustSelect();
  MemoryStore store;
  const auto summary = run(store);
  ASSERT_TRUE(summary) << summary.error().message;
  const repository::SampleTree& tree = *options_.points;
  EXPECT_EQ(summary->points, tree.points().size());
  EXPECT_GE(summary->points, 8U);
  EXPECT_LT(summary->points, pointsOutside() / 2);
  EXPECT_EQ(store.values.size(), 6 * tree.points().size());
  EXPECT_TRUE(tree.openLeaves().empty());
  EXPECT_TRUE(repository::verify(store, options_.grid, &tree)->empty());
  for (const glm::uvec3& p : tree.points())
    EXPECT_GT(glm::length(options_.grid.point(p.x, p.y, p.z)), 0.95F) << "nobody looks from within";

  // A second run has nothing to do; one that was killed goes on.
  const auto again = run(store);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->faces_rendered, 0U);
  store.values.erase(store.values.begin());
  const auto repaired = run(store);
  ASSERT_TRUE(repaired);
  EXPECT_EQ(repaired->faces_rendered, 1U);
  EXPECT_EQ(repaired->points, summary->points);
}

TEST_F(SelectionTest, shardsTogetherAreTheWholeValueByValue) {
  mustSelect();
  MemoryStore whole;
  ASSERT_TRUE(run(whole));
  std::map<FaceKey, base::Bytes> together;
  for (std::uint32_t i = 0; i < 3; ++i) {
    options_.shard = {i, 3};
    MemoryStore store;
    ASSERT_TRUE(run(store));
    EXPECT_EQ(store.meta, whole.meta);
    for (const auto& [key, value] : store.values) EXPECT_TRUE(together.emplace(key, value).second);
  }
  EXPECT_EQ(together, whole.values);
}

TEST_F(SelectionTest, otherPointsAndAPlainGridAreRefused) {
  mustSelect();
  MemoryStore store;
  ASSERT_TRUE(run(store));
  const BakeOptions good = options_;
  options_.points->leaveOut(options_.points->points().front());
  const auto other = run(store);
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().code, base::ErrorCode::kExists);
  EXPECT_NE(other.error().message.find("other sampling points"), std::string::npos) << other.error().message;
  options_ = good;
  options_.points.reset();
  options_.selection.views = 0;
  const auto plain = run(store);
  ASSERT_FALSE(plain);
  EXPECT_NE(plain.error().message.find("demand views"), std::string::npos) << plain.error().message;
}

TEST_F(SelectionTest, theMoreIsToBeKeptTheMorePointsThereAre) {
  std::size_t before = 0;
  for (const double worth : {0.6, 0.9, 1.0}) {
    options_.selection.worth = worth;
    const auto selected = select();
    ASSERT_TRUE(selected) << selected.error().message;
    EXPECT_FALSE(selected->tiles) << "these are plain faces";
    EXPECT_GT(selected->points.points().size(), before) << worth;
    before = selected->points.points().size();
  }
}

TEST_F(SelectionTest, theSameTreeWithAnyNumberOfThreads) {
  options_.limits.threads = 1;
  const auto one = select();
  options_.limits.threads = 4;
  const auto many = select();
  ASSERT_TRUE(one && many);
  EXPECT_EQ(one->points.encode(), many->points.encode());
}

TEST_F(SelectionTest, theImagesFitIntoTheBudget) {
  const auto bytesOf = [&](std::uint64_t budget) {
    options_.selection.budget_bytes = budget;
    mustSelect();
    MemoryStore store;
    EXPECT_TRUE(run(store));
    std::uint64_t bytes = 0;
    for (const auto& [key, value] : store.values) bytes += value.size();
    return bytes;
  };
  const std::uint64_t all = bytesOf(0);
  std::uint64_t before = all;
  for (const std::uint64_t budget : {all * 2, all * 3 / 4, all / 2, all / 8}) {
    const std::uint64_t bytes = bytesOf(budget);
    EXPECT_LE(bytes, std::min(budget, before));
    EXPECT_GT(bytes, std::min(budget, all) / 2) << "no more is left out than must be";
    before = bytes;
  }
}

TEST_F(SelectionTest, aBudgetForNoPointIsAnError) {
  options_.selection.budget_bytes = 100;
  const auto none = select();
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_NE(none.error().message.find("--budget"), std::string::npos) << none.error().message;
}

// Viewers were on the side of +x alone, and looked at the model.
TEST_F(SelectionTest, pointsLieWhereViewersWere) {
  repository::AccessFile file;
  file.identity.grid = options_.grid;
  for (const glm::uvec3& p : repository::pointsInMortonOrder(options_.grid))
    if (p.x == options_.grid.count.x - 1) file.counts.faces.push_back({{p.x, p.y, p.z, 1}, 1});
  const ViewerPlaces places({file});
  options_.selection.by_viewers = true;
  const auto there = select(&places);
  const auto anywhere = select();
  ASSERT_TRUE(there && anywhere);
  const auto meanX = [&](const repository::SampleTree& tree) {
    double sum = 0.0;
    for (const glm::uvec3& p : tree.points()) sum += static_cast<double>(options_.grid.point(p.x, p.y, p.z).x);
    return sum / static_cast<double>(tree.points().size());
  };
  EXPECT_GT(meanX(there->points), 0.8);
  EXPECT_LT(std::abs(meanX(anywhere->points)), 0.5);
  EXPECT_EQ(there->points.encode(), select(&places)->points.encode());
}

TEST_F(SelectionTest, aSelectionIsKeptForTheParametersThatItWasMadeFor) {
  const support::TemporaryDirectory directory;
  const std::string path = directory / "points.json";
  const auto none = readSelection(path, scene_.scene(), options_);
  ASSERT_TRUE(none);
  EXPECT_FALSE(*none);
  mustSelect();
  ASSERT_TRUE(writeSelection(path, scene_.scene(), options_));
  BakeOptions asked = options_;
  asked.points.reset();
  asked.shard = {1, 4};
  const auto same = readSelection(path, scene_.scene(), asked);
  ASSERT_TRUE(same && *same);
  EXPECT_EQ((*same)->points.encode(), options_.points->encode());
  asked.selection.views = 61;
  const auto other = readSelection(path, scene_.scene(), asked);
  ASSERT_TRUE(other);
  EXPECT_FALSE(*other);
}

TEST_F(SelectionTest, reportsThatItWasStopped) {
  const auto stopped = select(nullptr, [](double) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, base::ErrorCode::kCancelled);
}

TEST_F(SelectionTest, withoutAViewOfTheModelThereIsNothingToSelect) {
  options_.selection.views = 0;
  const auto none = select();
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, base::ErrorCode::kInvalidInput);
}

}  // namespace
}  // namespace server
