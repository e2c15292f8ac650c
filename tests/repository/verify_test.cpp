#include "repository/verify.h"

#include <gtest/gtest.h>

#include "repository/coverage.h"
#include "repository/face_value.h"
#include "repository/jpeg.h"
#include "tests/repository/temporary_directory.h"

namespace repository {
namespace {

constexpr std::uint32_t kFace = 24;

base::Bytes goodValue(int side = kFace) {
  const base::Bytes jpeg = *encodeJpeg(base::Image(side, side, 3), 80, Subsampling::k420);
  base::Image mask(kFace, kFace, 1);
  mask.pixels[5] = 255;
  return encodeFaceValue({false, jpeg, encodeCoverage(mask)});
}

// A 2 × 3 × 2 grid in a store, complete: a face of d = 5 is empty, the others hold pictures.
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

  test::TemporaryDirectory directory_;
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

TEST_F(VerifyTest, anEmptyStoreMissesAllInOneLine) {
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

TEST_F(VerifyTest, aPictureOfAnotherSizeIsFound) {
  put({0, 1, 0, 0}, goodValue(16));
  expectOneFault("(0, 1, 0, 0)", "16 x 16");
}

TEST_F(VerifyTest, aMaskThatCannotBeDecodedIsFound) {
  const base::Bytes jpeg = *encodeJpeg(base::Image(kFace, kFace, 3), 80, Subsampling::k420);
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
  ASSERT_EQ(found.size(), kMostFaults + 1);
  EXPECT_NE(found.back().find("stopped"), std::string::npos);
}

TEST_F(VerifyTest, contentsAddUp) {
  base::Bytes bad = goodValue();
  bad.back() ^= 1;
  put({0, 0, 0, 0}, bad);
  const Contents contents = *contentsOf(*store_);
  EXPECT_EQ(contents.faces, 72U);
  EXPECT_EQ(contents.empty, 12U);
  EXPECT_EQ(contents.unreadable, 1U);
  const base::Bytes good = goodValue();
  const FaceValue value = *decodeFaceValue(good);
  EXPECT_EQ(contents.jpeg_bytes, 59 * value.jpeg.size());
  EXPECT_EQ(contents.coverage_bytes, 59 * value.coverage.size());
}

}  // namespace
}  // namespace repository
