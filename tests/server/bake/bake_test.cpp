#include "server/bake/bake.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "repository/coverage.h"
#include "repository/face_value.h"
#include "repository/verify.h"
#include "tests/repository/temporary_directory.h"
#include "tests/server/bake/memory_store.h"
#include "tests/server/render/two_level_scene.h"

namespace server {
namespace {

using repository::FaceKey;
using test::MemoryStore;

// A unit sphere of `rings` rings around z, in two colours.
std::vector<test::Triangle> sphere(int rings, float from_z, float to_z) {
  const auto at = [&](int ring, int segment) {
    const float polar = std::acos(from_z + (to_z - from_z) * static_cast<float>(ring) / static_cast<float>(rings));
    const float around = 2.0F * std::numbers::pi_v<float> * static_cast<float>(segment) / static_cast<float>(2 * rings);
    return glm::vec3(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
  };
  std::vector<test::Triangle> triangles;
  for (int ring = 0; ring < rings; ++ring) {
    for (int segment = 0; segment < 2 * rings; ++segment) {
      const glm::u8vec4 color =
          (ring + segment) % 2 == 0 ? glm::u8vec4(220, 80, 60, 255) : glm::u8vec4(60, 90, 200, 255);
      triangles.push_back({at(ring, segment), at(ring, segment + 1), at(ring + 1, segment + 1), color});
      triangles.push_back({at(ring, segment), at(ring + 1, segment + 1), at(ring + 1, segment), color});
    }
  }
  std::erase_if(triangles,
                [](const test::Triangle& t) { return glm::length(glm::cross(t.b - t.a, t.c - t.a)) < 1e-3F; });
  return triangles;
}

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

TEST_F(BakeTest, everyFaceOfTheGridIsStoredAndVerifies) {
  const repository::test::TemporaryDirectory directory;
  const auto store = std::move(*repository::openLmdbStore(directory / "images", repository::StoreMode::kWrite));
  const auto summary = run(*store);
  ASSERT_TRUE(summary) << summary.error().message;
  EXPECT_EQ(summary->faces_rendered, 27U * 6U);
  EXPECT_EQ(*store->size(), 27U * 6U);
  EXPECT_TRUE(repository::verify(*store, options_.grid)->empty());
  const repository::Contents contents = *repository::contentsOf(*store);
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
  const auto removed = repository::removeFaulty(store, options_.grid, options_.shard, 2);
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
  std::vector<BakeOptions> bad(7, good);
  bad[0].quality = 0;
  bad[1].grid = {};
  bad[2].grid.face_size = 0;
  bad[3].batch_faces = 0;
  bad[4].grid.count = glm::uvec3(1 << 12);
  bad[5].shard = {4, 4};
  bad[6].shard = {0, 0};
  for (const BakeOptions& options : bad) {
    options_ = options;
    MemoryStore store;
    const auto refused = run(store);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_FALSE(store.meta.has_value());
  }
}

}  // namespace
}  // namespace server
