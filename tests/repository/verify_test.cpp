#include "repository/verify.h"

#include <gtest/gtest.h>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

constexpr std::uint32_t kFace = 24;

base::Bytes goodValue(int side = kFace) {
  const base::Bytes jpeg = *base::encodeJpeg(base::Image(side, side, 3), 80, base::Subsampling::k420);
  base::Image mask(kFace, kFace, 1);
  mask.pixels[5] = 255;
  return encodeFaceValue({false, jpeg, encodeCoverage(mask)});
}

// The store holds a complete grid of 2 × 3 × 2 points. Faces with d = 5 are empty, the others hold pictures.
class VerifyTest : public testing::Test {
 protected:
  VerifyTest() {
    grid_.count = glm::uvec3(2, 3, 2);
    grid_.face_size = kFace;
    store_ = std::move(*openLmdbStore(directory_ / "images", StoreMode::kWrite));
    std::vector<std::pair<FaceKey, base::Bytes>> batch;
    for (const glm::uvec3& p : pointsInMortonOrder(grid_)) {
      for (std::uint32_t d = 0; d < 6; ++d)
        batch.emplace_back(FaceKey{p.x, p.y, p.z, d}, d == 5 ? encodeFaceValue({}) : goodValue());
    }
    EXPECT_TRUE(store_->putBatch(batch));
  }
  void put(const FaceKey& key, const base::Bytes& value) { EXPECT_TRUE(store_->putBatch({{key, value}})); }
  std::vector<std::string> faults() { return *verify(*store_, grid_, nullptr, 2); }
  void expectOneFault(const std::string& place, const std::string& what) {
    const auto found = faults();
    ASSERT_EQ(found.size(), 1U);
    EXPECT_NE(found[0].find(place), std::string::npos) << found[0];
    EXPECT_NE(found[0].find(what), std::string::npos) << found[0];
  }

  support::TemporaryDirectory directory_;
  Grid grid_;
  std::unique_ptr<Store> store_;
};

TEST_F(VerifyTest, aWholeRepositoryHasNoFault) {
  EXPECT_TRUE(faults().empty());
}

TEST_F(VerifyTest, aMissingFaceIsNamed) {
  ASSERT_TRUE(store_->erase({{1, 2, 0, 3}}));
  expectOneFault("(1, 2, 0, 3)", "missing");
}

TEST_F(VerifyTest, faultsAtBothEndsAreFound) {
  ASSERT_TRUE(store_->erase({{0, 0, 0, 0}, {1, 2, 1, 4}, {1, 2, 1, 5}}));
  const auto found = faults();
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0], "face (0, 0, 0, 0): missing");
  EXPECT_NE(found[1].find("(1, 2, 1, 4) and the 1 after"), std::string::npos) << found[1];
}

TEST_F(VerifyTest, anEmptyStoreIsReportedInOneLine) {
  std::vector<FaceKey> all;
  for (const glm::uvec3& p : pointsInMortonOrder(grid_)) {
    for (std::uint32_t d = 0; d < 6; ++d) all.push_back({p.x, p.y, p.z, d});
  }
  ASSERT_TRUE(store_->erase(all));
  expectOneFault("(0, 0, 0, 0)", "71 after it");
}

TEST_F(VerifyTest, aFlippedBitIsFound) {
  base::Bytes value = goodValue();
  value[30] ^= 4;
  put({1, 1, 1, 2}, value);
  expectOneFault("(1, 1, 1, 2)", "checksum");
}

TEST_F(VerifyTest, aPictureThatCannotBeDecodedIsFound) {
  put({0, 1, 0, 0}, encodeFaceValue({false, base::Bytes{1, 2, 3}, {}}));
  expectOneFault("(0, 1, 0, 0)", "JPEG");
}

TEST_F(VerifyTest, aWebpThatCannotBeDecodedIsFound) {
  const base::Bytes webp{'R', 'I', 'F', 'F', 4, 0, 0, 0, 'W', 'E', 'B', 'P'};
  put({0, 1, 0, 0}, encodeFaceValue({false, webp, {}}));
  expectOneFault("(0, 1, 0, 0)", "WebP");
}

TEST_F(VerifyTest, aPictureOfAnotherSizeIsFound) {
  put({0, 1, 0, 0}, goodValue(16));
  expectOneFault("(0, 1, 0, 0)", "16 x 16");
}

TEST_F(VerifyTest, aMaskThatCannotBeDecodedIsFound) {
  const base::Bytes jpeg = *base::encodeJpeg(base::Image(kFace, kFace, 3), 80, base::Subsampling::k420);
  put({0, 1, 0, 0}, encodeFaceValue({false, jpeg, base::Bytes{1, 2, 3}}));
  expectOneFault("(0, 1, 0, 0)", "coverage");
}

TEST_F(VerifyTest, aKeyOutsideTheGridIsFound) {
  put({2, 0, 0, 0}, goodValue());
  expectOneFault("(2, 0, 0, 0)", "not a face of this grid");
}

TEST_F(VerifyTest, manyFaultsEndInOneLineThatSaysSo) {
  for (std::uint32_t x = 0; x < 120; ++x) put({x, 3, 0, 0}, goodValue());
  const auto found = faults();
  ASSERT_EQ(found.size(), kMaxFaults + 1);
  EXPECT_NE(found.back().find("stopped"), std::string::npos);
}

// Shard 1 of 3 holds those of the 12 points that have places 4 to 7 in Morton order.
TEST_F(VerifyTest, aShardIsExpectedToHoldOnlyItsOwnFaces) {
  const auto found = *verify(*store_, grid_, nullptr, 2, {1, 3});
  ASSERT_EQ(found.size(), 48U) << "the 8 points of other shards";
  EXPECT_NE(found.front().find("does not belong to shard 1 of 3"), std::string::npos) << found.front();
  const auto points = pointsInMortonOrder(grid_);
  std::vector<FaceKey> strangers;
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::uint32_t d = 0; d < 6 && (i < 4 || i > 7); ++d)
      strangers.push_back({points[i].x, points[i].y, points[i].z, d});
  ASSERT_TRUE(store_->erase(strangers));
  EXPECT_TRUE(verify(*store_, grid_, nullptr, 2, {1, 3})->empty());
  ASSERT_TRUE(store_->erase({{points[4].x, points[4].y, points[4].z, 0}}));
  const auto gap = *verify(*store_, grid_, nullptr, 2, {1, 3});
  ASSERT_EQ(gap.size(), 1U);
  EXPECT_NE(gap[0].find("missing"), std::string::npos);
}

TEST_F(VerifyTest, removeFaultyErasesNothingElse) {
  base::Bytes flipped = goodValue();
  flipped[30] ^= 4;
  put({1, 1, 1, 2}, flipped);
  put({0, 1, 0, 0}, encodeFaceValue({false, base::Bytes{1, 2, 3}, {}}));
  put({0, 0, 1, 1}, goodValue(16));
  put({2, 0, 0, 0}, goodValue());
  put({40, 40, 40, 5}, flipped);
  const auto removed = removeFaulty(*store_, grid_, {0, 1}, nullptr, 2);
  ASSERT_TRUE(removed);
  EXPECT_EQ(removed->damaged, 3U);
  EXPECT_EQ(removed->orphans, 2U);
  const auto left = faults();
  EXPECT_EQ(left.size(), 3U);
  for (const std::string& fault : left) EXPECT_NE(fault.find("missing"), std::string::npos) << fault;
  EXPECT_EQ(*store_->size(), 69U);
  EXPECT_EQ(removeFaulty(*store_, grid_, {0, 1}, nullptr, 2)->damaged, 0U);
}

// One cell covers the whole grid, so that all its points are corners; the tree leaves out one of them.
TEST_F(VerifyTest, imagesOutsideTheTreeAreOrphansAndErased) {
  grid_.count = glm::uvec3(2, 2, 2);
  SampleTree tree(grid_, 1);
  tree.leaveOut({1, 0, 1});
  const auto found = *verify(*store_, grid_, &tree, 2, {0, 1});
  ASSERT_EQ(found.size(), 30U) << "5 points: one left out, four outside of the grid";
  const auto removed = removeFaulty(*store_, grid_, {0, 1}, &tree, 2);
  ASSERT_TRUE(removed);
  EXPECT_EQ(removed->orphans, 30U);
  EXPECT_EQ(removed->damaged, 0U);
  EXPECT_TRUE(verify(*store_, grid_, &tree, 2)->empty());
  ASSERT_TRUE(store_->erase({{1, 1, 1, 5}}));
  const auto gap = *verify(*store_, grid_, &tree, 2);
  ASSERT_EQ(gap.size(), 1U);
  EXPECT_NE(gap[0].find("face (1, 1, 1, 5): missing"), std::string::npos) << gap[0];
}

TEST_F(VerifyTest, contentsAddUp) {
  base::Bytes bad = goodValue();
  bad.back() ^= 1;
  put({0, 0, 0, 0}, bad);
  const StoreContents contents = *contentsOf(*store_);
  EXPECT_EQ(contents.faces, 72U);
  EXPECT_EQ(contents.empty, 12U);
  EXPECT_EQ(contents.unreadable, 1U);
  const base::Bytes good = goodValue();
  const FaceValue value = *decodeFaceValue(good);
  EXPECT_EQ(contents.jpeg_bytes, 59 * value.picture.size());
  EXPECT_EQ(contents.coverage_bytes, 59 * value.coverage.size());
}

// A face of which tiles 0, 1 and 6 are stored: each names the next.
class VerifyTilesTest : public testing::Test {
 protected:
  VerifyTilesTest() {
    grid_.count = glm::uvec3(2, 2, 2);
    grid_ = withTiles(grid_, 2);
    store_ = std::move(*openLmdbStore(directory_ / "images", StoreMode::kWrite));
    std::vector<std::pair<FaceKey, base::Bytes>> batch;
    for (const glm::uvec3& p : pointsInMortonOrder(grid_))
      for (std::uint32_t d = 0; d < 6; ++d) batch.emplace_back(FaceKey{p.x, p.y, p.z, d}, encodeFaceValue({}));
    EXPECT_TRUE(store_->putBatch(batch));
    put(0, 1), put(1, 2), put(6, 0);
  }
  static FaceKey key(std::uint32_t tile) { return {1, 0, 1, 2, tile}; }
  void put(std::uint32_t tile, std::uint8_t children) {
    const base::Bytes jpeg = *base::encodeJpeg(base::Image(kTileSide, kTileSide, 3), 80, base::Subsampling::k420);
    EXPECT_TRUE(store_->putBatch({{key(tile), encodeFaceValue({false, jpeg, {}, children})}}));
  }
  std::vector<std::string> faults() { return *verify(*store_, grid_, nullptr, 2); }

  support::TemporaryDirectory directory_;
  Grid grid_;
  std::unique_ptr<Store> store_;
};

TEST_F(VerifyTilesTest, facesOfTilesHaveNoFault) {
  EXPECT_EQ(faults(), std::vector<std::string>{});
}

TEST_F(VerifyTilesTest, tilesThatAreNamedAndNotStoredAreFaults) {
  ASSERT_TRUE(store_->erase({key(6)}));
  EXPECT_EQ(faults(), std::vector<std::string>{"tile 6 of face (1, 0, 1, 2): missing, others of its face are here"});
  ASSERT_TRUE(store_->erase({key(1)}));
  EXPECT_EQ(faults(), std::vector<std::string>{"tile 1 of face (1, 0, 1, 2): missing, others of its face are here"});
  ASSERT_TRUE(store_->erase({key(0)}));
  EXPECT_EQ(faults(), std::vector<std::string>{"face (1, 0, 1, 2): missing"});
}

TEST_F(VerifyTilesTest, tilesThatNoOtherNamesAreFaultsAndAreErased) {
  put(8, 0);
  EXPECT_EQ(faults(), std::vector<std::string>{"tile 8 of face (1, 0, 1, 2): no other tile of its face names it"});
  const auto removed = removeFaulty(*store_, grid_, {0, 1});
  ASSERT_TRUE(removed);
  EXPECT_EQ(removed->orphans, 1U);
  EXPECT_EQ(faults(), std::vector<std::string>{});
}

TEST_F(VerifyTilesTest, oneOfTooGreatADepthIsNoTileOfTheGrid) {
  put(firstTileOf(3), 0);
  const auto found = faults();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NE(found[0].find("tile 21 of face (1, 0, 1, 2): not a face of this grid"), std::string::npos) << found[0];
}

TEST_F(VerifyTilesTest, aDamagedTileIsOneFaultWhateverItNamed) {
  const base::Bytes cut(9, 0x46);
  ASSERT_TRUE(store_->putBatch({{key(1), cut}}));
  const auto found = faults();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NE(found[0].find("tile 1 of face (1, 0, 1, 2)"), std::string::npos) << found[0];
}

}  // namespace
}  // namespace repository
