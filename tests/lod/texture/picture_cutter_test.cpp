// Pages that copy the blocks of their picture's JPEG show what it shows.
#include "lod/texture/picture_cutter.h"

#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <algorithm>

#include "base/jpeg/jpeg.h"
#include "tests/lod/texture/texture_testing.h"

namespace lod::texture {
namespace {

using namespace texture_testing;

// A JPEG, and what a decoder makes of it.
struct JpegPicture {
  base::Bytes bytes;
  base::Image image;
};
JpegPicture jpegOf(const base::Image& image, base::Subsampling subsampling, int quality = 90) {
  JpegPicture picture;
  picture.bytes = *base::encodeJpeg(image, quality, subsampling);
  picture.image = *base::decodeJpeg(picture.bytes);
  return picture;
}

// Fine detail on gradients, so that a texel that is a little off shows.
base::Image detailed(int width, int height) {
  base::Image image = smooth(width, height);
  std::mt19937 random(4);
  for (std::uint8_t& value : image.pixels)
    value = static_cast<std::uint8_t>(std::clamp(int{value} + static_cast<int>(random() % 31) - 15, 0, 255));
  return image;
}

struct CutUp {
  std::vector<std::vector<Page>> leaves;  // decoded
  int decodings = 0;                      // of the picture
};
// Cuts a JPEG up for leaves by its blocks, or if `plain` by its texels.
CutUp cutUp(const JpegPicture& picture, const std::vector<std::vector<PictureTriangle>>& leaves, bool plain = false) {
  CutUp out;
  const base::ByteView bytes = plain ? base::ByteView() : base::ByteView(picture.bytes);
  auto cutter = PictureCutter::open(bytes, {}, [&]() -> base::Result<base::Image> {
    ++out.decodings;
    return picture.image;
  });
  std::vector<std::uint32_t> numbers;
  for (const auto& leaf : leaves) numbers.push_back(cutter->add(leaf));
  cutter->finish();
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const auto pages = cutter->cut(leaves[i], numbers[i]);
    EXPECT_TRUE(pages);
    out.leaves.emplace_back();
    for (const EncodedPage& page : *pages) {
      auto decoded = decodePage(page.bytes);
      EXPECT_TRUE(decoded) << decoded.error().message;
      EXPECT_EQ(decoded->triangles, page.triangles);
      out.leaves.back().push_back(std::move(*decoded));
    }
  }
  return out;
}

class BlockPages : public testing::TestWithParam<base::Subsampling> {};
INSTANTIATE_TEST_SUITE_P(Sampled, BlockPages,
                         testing::Values(base::Subsampling::k420, base::Subsampling::k422, base::Subsampling::k444),
                         [](const auto& sampled) { return "at" + std::to_string(static_cast<int>(sampled.param)); });

TEST_P(BlockPages, ofASurfaceThatGoesOnAreExactlyThePicture) {
  const JpegPicture picture = jpegOf(detailed(400, 300), GetParam());
  // Four leaves share a rectangle that lies inside the picture. They meet at a corner which is at no unit's.
  const glm::vec2 min(16.0F, 32.0F), max(336.0F, 272.0F), middle(171.0F, 149.0F);
  const std::vector<std::vector<PictureTriangle>> leaves{
      grid(min, middle, 6), grid({middle.x, min.y}, {max.x, middle.y}, 6),
      grid({min.x, middle.y}, {middle.x, max.y}, 6), grid(middle, max, 6)};
  const CutUp made = cutUp(picture, leaves);
  EXPECT_EQ(made.decodings, 0);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    ASSERT_EQ(numbersOf(made.leaves[i]).size(), leaves[i].size());
    // Look-ups at the outer edge see texels beyond it, which have colours of those beside them.
    std::vector<PictureTriangle> inner;
    for (const PictureTriangle& t : leaves[i])
      if (std::all_of(t.corners.begin(), t.corners.end(), [&](const glm::vec2& c) {
            return c.x > min.x + 2.0F && c.y > min.y + 2.0F && c.x < max.x - 2.0F && c.y < max.y - 2.0F;
          }))
        inner.push_back(t);
    std::vector<Page> pages = made.leaves[i];
    for (Page& page : pages)
      std::erase_if(page.triangles, [&](const PageTriangle& t) {
        return std::none_of(inner.begin(), inner.end(),
                            [&](const PictureTriangle& p) { return p.triangle == t.triangle; });
      });
    ASSERT_FALSE(inner.empty());
    EXPECT_LT(lookUpDifference(pages, picture.image, inner), 1e-3F);
  }
}

TEST_P(BlockPages, areTheSameBytesWithUnitsThatWereFoundBefore) {
  const base::Image image = detailed(400, 300);
  base::Bytes jpeg;
  ASSERT_TRUE((*base::beginJpeg(image.width, image.height, 90, GetParam(), jpeg))->add(image));
  const auto quarter = base::JpegBlocks::readQuarter(jpeg, std::uint64_t{1} << 30);
  ASSERT_TRUE(quarter);
  const std::vector<PictureTriangle> leaf = grid({21.0F, 35.0F}, {333.0F, 270.0F}, 6);
  std::vector<base::Bytes> made;
  for (const base::ByteView units : {base::ByteView(), base::ByteView(quarter->units)}) {
    auto cutter = PictureCutter::open(jpeg, units, [] { return base::Result<base::Image>(base::Image()); });
    ASSERT_TRUE(cutter);
    const std::uint32_t number = cutter->add(leaf);
    cutter->finish();
    const auto pages = cutter->cut(leaf, number);
    ASSERT_TRUE(pages && pages->size() == 1);
    made.push_back(pages->front().bytes);
  }
  EXPECT_EQ(made[0], made[1]);
}

TEST_P(BlockPages, ofChartsBetweenGapsAreNearThePicture) {
  // Charts on black, at places that are no unit's.
  base::Image image(500, 420, 3);
  const base::Image detail = smooth(500, 420);
  std::vector<PictureTriangle> leaf;
  for (const auto& [min, max] : {std::pair<glm::vec2, glm::vec2>{{21.3F, 17.5F}, {133.0F, 111.1F}},
                                 {{150.0F, 20.0F}, {331.5F, 160.3F}},
                                 {{380.0F, 203.0F}, {470.5F, 377.0F}},
                                 {{40.0F, 200.0F}, {341.0F, 399.0F}}}) {
    for (int y = static_cast<int>(min.y) - 1; y < max.y + 1.0F; ++y)
      for (int x = static_cast<int>(min.x) - 1; x < max.x + 1.0F; ++x) std::copy_n(detail.at(x, y), 3, image.at(x, y));
    addGrid(leaf, min, max, 4);
  }
  const JpegPicture picture = jpegOf(image, GetParam(), 95);
  const CutUp made = cutUp(picture, {leaf});
  EXPECT_EQ(made.decodings, 0);
  ASSERT_EQ(numbersOf(made.leaves[0]).size(), leaf.size());
  // Coarser colours of the JPEG are mixed with the black beside them, so that no page is right at edges. Pages of
  // blocks err no more than those that are cut out by texels and coded anew.
  const CutUp plain = cutUp(picture, {leaf}, true);
  EXPECT_LE(lookUpDifference(made.leaves[0], detail, leaf), lookUpDifference(plain.leaves[0], detail, leaf) + 1.0F);
}

TEST(BlockPage, keepsChartsApartInMipLevels) {
  // Charts of one colour each touch, and so share units. A texel of a level in use has one chart's colour.
  base::Image image(256, 128, 3);
  paint(image, {0, 0}, {100, 128}, {200, 40, 40});
  paint(image, {100, 0}, {256, 128}, {40, 40, 200});
  std::vector<PictureTriangle> leaf = grid({3.0F, 3.0F}, {100.0F, 125.0F}, 5);
  const std::size_t red = leaf.size();
  addGrid(leaf, {100.0F, 3.0F}, {250.0F, 120.0F}, 4);
  const CutUp made = cutUp(jpegOf(image, base::Subsampling::k444, 100), {leaf});
  EXPECT_EQ(made.decodings, 0);
  std::mt19937 random(3);
  for (const Page& page : made.leaves[0]) {
    ASSERT_GT(page.levels, 1U);
    const std::vector<Level> levels = mipLevels(page.image, page.levels);
    for (const PageTriangle& t : page.triangles)
      for (std::uint32_t level = 0; level < page.levels; ++level)
        for (const glm::dvec3& shares : pointsOfTriangle(random)) {
          const glm::dvec2 at = pointOf(cornersOf(t), shares);
          const float wanted = t.triangle < red ? 200.0F : 40.0F;
          ASSERT_NEAR(lookUp(levels[level], at, static_cast<int>(level), 0), wanted, 6.0F) << level;
        }
  }
}

TEST(BlockPage, ofAPictureAsLargeAsAPageIsThePicture) {
  const JpegPicture picture = jpegOf(detailed(4096, 64), base::Subsampling::k420);
  const std::vector<PictureTriangle> leaf = grid({0.0F, 0.0F}, {4096.0F, 64.0F}, 8);
  const CutUp made = cutUp(picture, {leaf});
  EXPECT_EQ(made.decodings, 0);
  ASSERT_EQ(made.leaves[0].size(), 1U);
  const Page& page = made.leaves[0][0];
  ASSERT_EQ(page.image.width, 4096);
  ASSERT_EQ(page.triangles[0].corners[0].x, 0);
  const int down = page.triangles[0].corners[0].y / kCornerSteps;
  // Above and below lies the other edge of the picture, which repeats; coarser colours are mixed with its.
  for (int y = 1; y < 63; ++y)
    ASSERT_TRUE(
        std::equal(picture.image.at(0, y), picture.image.at(0, y) + std::size_t{3} * 4096, page.image.at(0, y + down)))
        << y;
}

TEST(BlockPage, wherePicturesRepeatShowsTheOtherEdge) {
  const JpegPicture picture = jpegOf(detailed(160, 96), base::Subsampling::k444);
  const std::vector<PictureTriangle> leaf = grid({100.0F, 60.0F}, {220.0F, 140.0F}, 6);
  const CutUp made = cutUp(picture, {leaf});
  EXPECT_EQ(made.decodings, 0);
  std::vector<Page> pages = made.leaves[0];
  std::vector<PictureTriangle> inner = leaf;
  std::erase_if(inner, [](const PictureTriangle& t) {
    return std::any_of(t.corners.begin(), t.corners.end(),
                       [](const glm::vec2& c) { return c.x < 110.0F || c.y < 70.0F || c.x > 210.0F || c.y > 130.0F; });
  });
  for (Page& page : pages)
    std::erase_if(page.triangles, [&](const PageTriangle& t) {
      return std::none_of(inner.begin(), inner.end(),
                          [&](const PictureTriangle& p) { return p.triangle == t.triangle; });
    });
  ASSERT_EQ(numbersOf(pages).size(), 32U);
  EXPECT_LT(lookUpDifference(pages, picture.image, inner), 1e-3F);
}

TEST(BlockPage, ofAWholePictureKnowsNothingOfTheOtherEdge) {
  // Coarser colours of the other edge, which lies beside it where the picture repeats, would be mixed in.
  base::Image image(128, 64, 3);
  paint(image, {0, 0}, {64, 64}, {200, 40, 40});
  paint(image, {64, 0}, {128, 64}, {40, 40, 200});
  const JpegPicture picture = jpegOf(image, base::Subsampling::k420, 95);
  const CutUp made = cutUp(picture, {grid({0.0F, 0.0F}, {128.0F, 64.0F}, 2)});
  EXPECT_EQ(made.decodings, 0);
  const Page& page = made.leaves[0][0];
  const glm::ivec2 at(page.triangles[0].corners[0] / std::uint16_t{kCornerSteps});
  for (int y = 0; y < 64; ++y)
    for (const int x : {0, 127})
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(page.image.at(at.x + x, at.y + y)[c], picture.image.at(x, y)[c], 3);
}

TEST(BlockPage, isNotMadeWhereItWouldBeMostlyGutter) {
  // A hundred charts of 20 x 20 texels; in units of 16 they would take up to 48 x 48.
  const JpegPicture picture = jpegOf(detailed(640, 640), base::Subsampling::k420);
  std::vector<PictureTriangle> leaf;
  for (int i = 0; i < 100; ++i) {
    const glm::vec2 min(static_cast<float>(60 * (i % 10) + 13), static_cast<float>(60 * (i / 10) + 13));
    addGrid(leaf, min, min + 20.0F, 1);
  }
  const CutUp made = cutUp(picture, {leaf, grid({0.0F, 0.0F}, {4.0F, 4.0F}, 1)});
  EXPECT_EQ(made.decodings, 1);
  EXPECT_LT(lookUpDifference(made.leaves[0], picture.image, leaf), 24.0F);  // coded anew
}

// Some JPEGs are ones that base::encodeJpeg() does not make.
JpegPicture turboJpegOf(const base::Image& image, int format, int sampling, int flags) {
  std::uint8_t* bytes = nullptr;
  unsigned long length = 0;
  tjhandle encoder = tjInitCompress();
  EXPECT_EQ(tjCompress2(encoder, image.pixels.data(), image.width, 0, image.height, format, &bytes, &length, sampling,
                        90, flags),
            0);
  JpegPicture picture;
  picture.bytes.assign(bytes, bytes + length);
  tjFree(bytes);
  tjDestroy(encoder);
  picture.image = *base::decodeJpeg(picture.bytes);
  return picture;
}

TEST(BlockPage, progressivePicturesHaveOne) {
  const JpegPicture picture = turboJpegOf(detailed(96, 64), TJPF_RGB, TJSAMP_420, TJFLAG_PROGRESSIVE);
  const std::vector<PictureTriangle> leaf = grid({0.0F, 0.0F}, {96.0F, 64.0F}, 2);
  const CutUp made = cutUp(picture, {leaf});
  EXPECT_EQ(made.decodings, 0);
  ASSERT_EQ(made.leaves[0].size(), 1U);
  const Page& page = made.leaves[0][0];
  const glm::ivec2 at(page.triangles[0].corners[0] / std::uint16_t{kCornerSteps});
  for (int y = 1; y < 63; ++y)
    ASSERT_TRUE(std::equal(picture.image.at(1, y), picture.image.at(95, y), page.image.at(at.x + 1, at.y + y))) << y;
}

TEST(BlockPage, uncommonSamplingIsDecoded) {
  const JpegPicture picture = turboJpegOf(detailed(96, 64), TJPF_RGB, TJSAMP_411, 0);
  const std::vector<PictureTriangle> leaf = grid({10.0F, 10.0F}, {80.0F, 60.0F}, 2);
  const CutUp made = cutUp(picture, {leaf});
  EXPECT_EQ(made.decodings, 1);
  EXPECT_EQ(numbersOf(made.leaves[0]).size(), leaf.size());
}

TEST(BlockPage, pointsAndGreyPicturesHaveOne) {
  const base::Image image = detailed(64, 64);
  base::Image grey(64, 64, 1);
  for (std::size_t i = 0; i < grey.pixels.size(); ++i) grey.pixels[i] = image.pixels[3 * i];
  const JpegPicture picture = turboJpegOf(grey, TJPF_GRAY, TJSAMP_GRAY, 0);

  std::vector<PictureTriangle> leaf = grid({0.0F, 0.0F}, {64.0F, 64.0F}, 1);
  leaf.push_back({2, {glm::vec2(30.0F), glm::vec2(30.0F), glm::vec2(30.0F)}});
  const CutUp made = cutUp(picture, {leaf, {{0, {glm::vec2(9.0F), glm::vec2(9.0F), glm::vec2(9.0F)}}}});
  EXPECT_EQ(made.decodings, 0);
  EXPECT_EQ(numbersOf(made.leaves[0]), (std::vector<std::uint16_t>{0, 1, 2}));
  EXPECT_EQ(numbersOf(made.leaves[1]), (std::vector<std::uint16_t>{0}));
  const Page& page = made.leaves[0][0];
  ASSERT_EQ(page.triangles[0].triangle, 0);
  const glm::ivec2 at(page.triangles[0].corners[0] / std::uint16_t{kCornerSteps});
  for (int y = 0; y < 64; ++y)
    ASSERT_TRUE(std::equal(picture.image.at(0, y), picture.image.at(63, y) + 3, page.image.at(at.x, at.y + y))) << y;
}

}  // namespace
}  // namespace lod::texture
