#include "lod/texture/page.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>

#include "lod/texture/packing.h"
#include "tests/lod/texture/texture_testing.h"

namespace lod::texture {
namespace {

using namespace texture_testing;

bool same(const Page& a, const Page& b) {
  return a.triangles == b.triangles && a.image.width == b.image.width && a.image.pixels == b.image.pixels &&
         a.levels == b.levels && a.scale == b.scale;
}

// Charts of one colour each, all different, on black; chart i has the colour with number i + 1.
struct ColoredCharts {
  base::Image picture{1024, 1024, 3};
  std::vector<PictureTriangle> triangles;
  std::vector<std::vector<std::uint8_t>> color_of;  // by triangle
};
ColoredCharts coloredCharts(int cells) {
  ColoredCharts scene;
  std::mt19937 random(3);
  for (int j = 0; j < 8; ++j) {
    for (int i = 0; i < 8; ++i) {
      const glm::vec2 min(128.0F * static_cast<float>(i) + 20.0F + 0.125F * static_cast<float>(random() % 40),
                          128.0F * static_cast<float>(j) + 20.0F);
      const glm::vec2 size(5.0F + 0.5F * static_cast<float>(random() % 160), 5.0F + static_cast<float>(random() % 80));
      const std::vector<std::uint8_t> color{static_cast<std::uint8_t>(30 * i + 20),
                                            static_cast<std::uint8_t>(30 * j + 20),
                                            static_cast<std::uint8_t>(255 - 20 * i)};
      paint(scene.picture, glm::ivec2(min) - 3, glm::ivec2(min + size) + 4, color);
      addGrid(scene.triangles, min, min + size, cells);
      scene.color_of.resize(scene.triangles.size(), color);
    }
  }
  return scene;
}

// Colours of texels --------------------------------------------------------------------------------

TEST(Page, lookUpsInATriangleAreThoseInThePicture) {
  const base::Image picture = noise(300, 200);
  std::vector<PictureTriangle> triangles = grid({10.3F, 20.7F}, {90.0F, 111.1F}, 5);
  addGrid(triangles, {150.0F, 20.0F}, {171.5F, 60.0F}, 3);
  const auto pages = makePages(picture, triangles);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].scale, 1.0F);
  EXPECT_EQ(pages[0].image.channels, 3);
  EXPECT_EQ(numbersOf(pages).size(), triangles.size());
  EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F);
}

TEST(Page, chartsMoveByWholeTexels) {
  const auto triangles = grid({10.25F, 20.5F}, {90.125F, 40.0F}, 2);
  for (const Page& page : makePages(noise(100, 100), triangles)) {
    for (const PageTriangle& placed : page.triangles) {
      for (int i = 0; i < 3; ++i) {
        const glm::dvec2 moved = cornersOf(placed)[i] - cornersOf(triangles[placed.triangle])[i];
        EXPECT_EQ(moved, glm::floor(moved));
      }
    }
  }
}

TEST(Page, mirroredAndTurnedTrianglesKeepTheirTexels) {
  const base::Image picture = noise(256, 256);
  std::vector<PictureTriangle> triangles = grid({100.0F, 90.0F}, {20.0F, 30.0F}, 4);
  addGrid(triangles, {120.0F, 200.0F}, {180.0F, 130.0F}, 2);
  for (PictureTriangle& triangle : triangles)  // turned by 30 degrees
    for (glm::vec2& corner : triangle.corners)
      corner = {0.866F * corner.x - 0.5F * corner.y + 80.0F, 0.5F * corner.x + 0.866F * corner.y - 10.0F};
  EXPECT_LT(lookUpDifference(makePages(picture, triangles), picture, triangles), 1e-3F);
}

TEST(Page, thePictureRepeats) {
  const base::Image picture = noise(64, 48);
  for (const glm::vec2 at : {glm::vec2(50.0F, 40.0F), glm::vec2(-30.5F, -100.0F), glm::vec2(900.0F, 10.0F)}) {
    std::vector<PictureTriangle> triangles = grid(at, at + glm::vec2(40.0F, 30.0F), 3);
    addGrid(triangles, at + glm::vec2(500.0F), at + glm::vec2(520.0F), 1);
    const auto pages = makePages(picture, triangles);
    EXPECT_EQ(numbersOf(pages).size(), triangles.size());
    EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F) << at.x;
  }
}

// A floor of 30 × 30 tiles, two triangles each.
TEST(Page, tilesThatRepeatThePictureShareItsTexels) {
  const base::Image picture = noise(128, 128);
  const auto triangles = grid({0.0F, 0.0F}, {3840.0F, 3840.0F}, 30);
  const auto pages = makePages(picture, triangles);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].scale, 1.0F);
  EXPECT_EQ(pages[0].triangles.size(), triangles.size());
  EXPECT_LE(pages[0].image.width, 132);
  EXPECT_LE(pages[0].image.height, 132);
  EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F);
}

// Levels -------------------------------------------------------------------------------------------

TEST(Page, mipLevelsKeepChartsApart) {
  for (const int cells : {1, 2, 6}) {
    const ColoredCharts scene = coloredCharts(cells);
    const auto pages = makePages(scene.picture, scene.triangles);
    ASSERT_EQ(pages.size(), 1U);
    const Page& page = pages[0];
    EXPECT_GE(page.levels, 2U);
    EXPECT_EQ(page.image.width % (1 << (page.levels - 1)), 0);
    EXPECT_EQ(page.image.height % (1 << (page.levels - 1)), 0);
    std::mt19937 random(5);
    const auto levels = mipLevels(page.image, page.levels);
    for (const PageTriangle& placed : page.triangles) {
      for (const glm::dvec3& shares : pointsOfTriangle(random)) {
        for (std::uint32_t l = 0; l < page.levels; ++l)
          for (int c = 0; c < 3; ++c)
            ASSERT_NEAR(lookUp(levels[l], pointOf(cornersOf(placed), shares), static_cast<int>(l), c),
                        scene.color_of[placed.triangle][static_cast<std::size_t>(c)], 1e-2)
                << "triangle " << placed.triangle << ", level " << l << " of " << page.levels;
      }
    }
  }
}

TEST(Page, largeTrianglesHaveMoreLevelsThanSmallOnes) {
  std::vector<PictureTriangle> large = grid({0.0F, 0.0F}, {400.0F, 400.0F}, 5);
  addGrid(large, {500.0F, 0.0F}, {900.0F, 400.0F}, 5);
  std::vector<PictureTriangle> small = grid({0.0F, 0.0F}, {400.0F, 400.0F}, 40);
  addGrid(small, {500.0F, 0.0F}, {900.0F, 400.0F}, 40);
  const base::Image picture(1000, 500, 3);
  EXPECT_EQ(makePages(picture, large)[0].levels, 6U);  // edges of 91 texels, gutters of a third
  EXPECT_EQ(makePages(picture, small)[0].levels, 5U);  // edges of 11 texels
}

// Along an oblique edge the texels beside the chart go on as the chart ends: a level's mean over both differs little
// from the chart's own.
TEST(Page, noLineShowsAtAChartsEdgeInMipLevels) {
  base::Image picture(512, 512, 3);
  for (int y = 0; y < 512; ++y)
    for (int x = 0; x < 512; ++x)
      paint(picture, {x, y}, {x + 1, y + 1},
            std::vector<std::uint8_t>(3, x + y < 520 ? static_cast<std::uint8_t>(100 + x / 4) : std::uint8_t{0}));
  const std::vector<PictureTriangle> triangles{{0, {{{8.0F, 8.0F}, {500.0F, 8.0F}, {8.0F, 500.0F}}}}};
  const auto pages = makePages(picture, triangles);
  ASSERT_EQ(pages.size(), 1U);
  const auto levels = mipLevels(pages[0].image, 5);
  std::mt19937 random(5);
  for (const glm::dvec3& shares : pointsOfTriangle(random)) {
    const double expected = 100.0 + (pointOf(cornersOf(triangles[0]), shares).x - 0.5) / 4.0;
    for (int l = 0; l < 5; ++l)
      EXPECT_NEAR(lookUp(levels[static_cast<std::size_t>(l)], pointOf(cornersOf(pages[0].triangles[0]), shares), l, 0),
                  expected, 1.0 + 0.35 * std::pow(2.0, l))
          << l;
  }
}

TEST(Page, everyTexelHasAColourOfTheCharts) {
  const ColoredCharts scene = coloredCharts(1);
  for (const Page& page : makePages(scene.picture, scene.triangles))
    for (std::size_t i = 0; i < page.image.pixels.size(); i += 3)
      ASSERT_GE(int{page.image.pixels[i]}, 20) << "the picture's black shows at texel " << i / 3;
}

// Sizes --------------------------------------------------------------------------------------------

TEST(Page, aPictureAsLargeAsAPageIsNotReduced) {
  const base::Image picture = noise(256, 256);
  const auto triangles = grid({0.0F, 0.0F}, {256.0F, 256.0F}, 4);
  const auto pages = makePages(picture, triangles, 256);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].scale, 1.0F);
  EXPECT_EQ(pages[0].image.pixels, picture.pixels);
  EXPECT_EQ(pages[0].levels, 9U);
}

TEST(Page, aLargerChartIsReducedByTheLeastFactorThatFits) {
  base::Image picture(900, 400, 3);
  paint(picture, {100, 50}, {700, 250}, {200, 100, 50});
  std::vector<PictureTriangle> triangles = grid({100.0F, 50.0F}, {700.0F, 250.0F}, 6);
  addGrid(triangles, {800.0F, 300.0F}, {850.0F, 350.0F}, 2);
  const auto pages = makePages(picture, triangles, 256);
  ASSERT_EQ(pages.size(), 2U);
  const Page& reduced = pages[0].scale < 1.0F ? pages[0] : pages[1];
  EXPECT_EQ(reduced.scale, 1.0F / 3.0F);
  EXPECT_EQ(reduced.triangles.size(), 72U);
  EXPECT_LE(std::max(reduced.image.width, reduced.image.height), 256);
  EXPECT_EQ(numbersOf(pages).size(), triangles.size());

  // Black texels beside the chart are not mixed in, and corners go to a third of their places.
  for (std::size_t i = 0; i < reduced.image.pixels.size(); i += 3) ASSERT_GE(int{reduced.image.pixels[i]}, 150);
  const auto corners = cornersOf(reduced.triangles[0]);
  EXPECT_NEAR(glm::length(corners[1] - corners[0]), 100.0 / 3.0, 0.1);
}

TEST(Page, aReducedTexelIsTheMeanOfItsTexels) {
  const base::Image picture = noise(400, 400);
  const auto triangles = grid({0.0F, 0.0F}, {400.0F, 400.0F}, 1);
  const auto pages = makePages(picture, triangles, 200);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].scale, 0.5F);
  const Level half = mipLevels(picture, 2)[1];
  ASSERT_EQ(pages[0].image.width, half.width);
  for (std::size_t i = 0; i < half.texels.size(); ++i) ASSERT_NEAR(pages[0].image.pixels[i], half.texels[i], 0.51);
}

TEST(Page, aTriangleOverAHundredRepetitionsIsReduced) {
  base::Image picture = noise(64, 64);
  const auto triangles = grid({-10.0F, 0.0F}, {6390.0F, 6400.0F}, 1);
  const auto pages = makePages(picture, triangles, 512);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].scale, 1.0F / 13.0F);
  EXPECT_EQ(pages[0].triangles.size(), 2U);
  EXPECT_LE(pages[0].image.width, 512);
}

TEST(Page, chartsThatDoNotFitOnePageGoToSeveral) {
  const base::Image picture = noise(2048, 512);
  std::vector<PictureTriangle> triangles;
  for (int i = 0; i < 16; ++i)
    addGrid(triangles, {100.0F * static_cast<float>(i) + 3.0F, 0.0F}, {100.0F * static_cast<float>(i) + 93.0F, 300.0F},
            3);
  const auto pages = makePages(picture, triangles, 512);
  EXPECT_GT(pages.size(), 1U);
  EXPECT_LE(pages.size(), 4U);
  for (const Page& page : pages) {
    EXPECT_LE(std::max(page.image.width, page.image.height), 512);
    EXPECT_EQ(page.image.width % 4 + page.image.height % 4, 0);
    EXPECT_TRUE(std::is_sorted(page.triangles.begin(), page.triangles.end(),
                               [](const auto& a, const auto& b) { return a.triangle < b.triangle; }));
  }
  EXPECT_EQ(numbersOf(pages).size(), triangles.size());
  EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F);
}

TEST(Page, trianglesThatEachCoverAnotherPartOfAPictureAreReducedTogether) {
  const base::Image picture = noise(1024, 1024);
  std::vector<PictureTriangle> triangles;
  for (int i = 0; i < 200; ++i) {
    const glm::vec2 at(5.0F * static_cast<float>(i), 3.0F * static_cast<float>(i));
    triangles.push_back(
        {static_cast<std::uint16_t>(i), {at, at + glm::vec2(1000.0F, 0.0F), at + glm::vec2(0.0F, 1000.0F)}});
  }
  const auto pages = makePages(picture, triangles);
  EXPECT_EQ(numbersOf(pages).size(), 200U);
  EXPECT_LT(areaOf(pages), 1.2 * (1 << 26));
  for (const Page& page : pages) EXPECT_EQ(page.scale, 0.5F);
}

TEST(Page, guttersAndFreePlacesTakeAThirdAndAQuarter) {
  const ColoredCharts scene = coloredCharts(4);
  double charts = 0.0;
  for (std::size_t t = 0; t < scene.triangles.size(); t += 32) {  // first and last corner of a chart's rectangle
    const glm::vec2 size = scene.triangles[t + 31].corners[1] - scene.triangles[t].corners[0];
    charts += double{size.x + 3.0F} * double{size.y + 3.0F};
  }
  EXPECT_LT(areaOf(makePages(scene.picture, scene.triangles)), charts * 4.0 / 3.0 * 1.25);
}

TEST(Page, packingLeavesATenthFree) {
  std::mt19937 random(2);
  std::vector<glm::ivec2> sizes;
  double area = 0.0;
  for (int i = 0; i < 1000; ++i) {
    sizes.emplace_back(4 + random() % 60, 4 + random() % 60);
    area += double(sizes.back().x) * sizes.back().y;
  }
  const auto pages = packRectangles(sizes, 4096, 4);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_LT(double(pages[0].size.x) * pages[0].size.y, area / 0.9);

  // No two rectangles overlap, and none leaves the page.
  std::vector<char> taken(static_cast<std::size_t>(pages[0].size.x) * static_cast<std::size_t>(pages[0].size.y));
  for (const PackedRectangle& packed : pages[0].rectangles) {
    const glm::ivec2 end = packed.place + sizes[packed.index];
    ASSERT_TRUE(packed.place.x >= 0 && packed.place.y >= 0 && end.x <= pages[0].size.x && end.y <= pages[0].size.y);
    for (int y = packed.place.y; y < end.y; ++y)
      for (int x = packed.place.x; x < end.x; ++x)
        ASSERT_EQ(taken[static_cast<std::size_t>(y * pages[0].size.x + x)]++, 0);
  }
}

// Triangles ----------------------------------------------------------------------------------------

TEST(Page, trianglesWithoutAPlaceAreLeftOut) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  std::vector<PictureTriangle> triangles = grid({10.0F, 10.0F}, {20.0F, 20.0F}, 1);
  for (const glm::vec2 wrong :
       {glm::vec2(nan, 1.0F), glm::vec2(1.0F, infinite), glm::vec2(-2e6F, 0.0F), glm::vec2(0.0F, 1e30F)})
    triangles.push_back({static_cast<std::uint16_t>(triangles.size()), {glm::vec2(1.0F), wrong, glm::vec2(5.0F)}});
  const base::Image picture = noise(32, 32);
  EXPECT_EQ(numbersOf(makePages(picture, triangles)), (std::vector<std::uint16_t>{0, 1}));
  EXPECT_TRUE(makePages(picture, std::span(triangles).subspan(2)).empty());
  EXPECT_TRUE(makePages(picture, {}).empty());
}

TEST(Page, pointsAndLinesAreKept) {
  const base::Image picture = noise(64, 64);
  std::vector<PictureTriangle> triangles = grid({10.0F, 10.0F}, {20.0F, 20.0F}, 1);
  triangles.push_back({2, {glm::vec2(40.5F), glm::vec2(40.5F), glm::vec2(40.5F)}});
  triangles.push_back({3, {glm::vec2(50.0F), glm::vec2(55.0F), glm::vec2(60.0F)}});
  triangles.push_back({4, {glm::vec2(0.0F), glm::vec2(0.0F), glm::vec2(0.0F)}});
  const auto pages = makePages(picture, triangles);
  EXPECT_EQ(numbersOf(pages).size(), 5U);
  EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F);
  EXPECT_EQ(numbersOf(makePages(picture, std::span(triangles).subspan(4))).size(), 1U);
}

// Readers of meshes round coordinates each in its own way.
TEST(Page, cornersThatNearlyAgreeShareAnEdge) {
  const std::vector<PictureTriangle> triangles{
      {0, {glm::vec2(10.0F, 10.0F), glm::vec2(30.0F, 10.0F), glm::vec2(10.0F, 30.0F)}},
      {1, {glm::vec2(30.0F, 30.0F), glm::vec2(10.00001F, 30.0F), glm::vec2(30.0F, 9.99999F)}}};
  const auto pages = makePages(noise(64, 64), triangles);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].image.width, 24);
  EXPECT_EQ(pages[0].image.height, 24);
}

TEST(Page, aSoupOfFourThousandChartsFitsOnePage) {
  const base::Image picture = noise(2000, 2000);
  std::mt19937 random(9);
  std::vector<PictureTriangle> triangles;
  for (int i = 0; i < 4000; ++i) {
    const auto draw = [&](unsigned range) { return 0.125F * static_cast<float>(random() % (8 * range)); };
    const glm::vec2 at(draw(1900), draw(1900));
    triangles.push_back({static_cast<std::uint16_t>(i),
                         {at, at + glm::vec2(3.0F + draw(12), draw(8)), at + glm::vec2(draw(8), 3.0F + draw(12))}});
  }
  const auto pages = makePages(picture, triangles);
  ASSERT_EQ(pages.size(), 1U);
  EXPECT_EQ(pages[0].triangles.size(), 4000U);
  EXPECT_EQ(pages[0].levels, 2U);
  EXPECT_LT(areaOf(pages), 4000.0 * 16 * 16);
  EXPECT_LT(lookUpDifference(pages, picture, triangles), 1e-3F);
}

// Alpha --------------------------------------------------------------------------------------------

TEST(Page, alphaIsKeptOnlyWhereChartsHaveIt) {
  base::Image picture = noise(200, 100, 4);
  for (int y = 0; y < 100; ++y)
    for (int x = 0; x < 200; ++x) picture.at(x, y)[3] = x >= 10 && x < 60 ? 255 : 0;
  const auto opaque = makePages(picture, grid({15.0F, 20.0F}, {50.0F, 80.0F}, 2));
  ASSERT_EQ(opaque.size(), 1U);
  EXPECT_EQ(opaque[0].image.channels, 3);
  EXPECT_LT(lookUpDifference(opaque, picture, grid({15.0F, 20.0F}, {50.0F, 80.0F}, 2)), 1e-3F);
  const auto clear = makePages(picture, grid({15.0F, 20.0F}, {80.0F, 80.0F}, 2));
  ASSERT_EQ(clear.size(), 1U);
  EXPECT_EQ(clear[0].image.channels, 4);
  EXPECT_LT(lookUpDifference(clear, picture, grid({15.0F, 20.0F}, {80.0F, 80.0F}, 2)), 1e-3F);
}

// Sameness -----------------------------------------------------------------------------------------

TEST(Page, severalThreadsMakeTheSamePages) {
  const ColoredCharts scene = coloredCharts(3);
  const auto pages = makePages(scene.picture, scene.triangles, 256);
  std::vector<std::vector<Page>> others(4);
  std::vector<std::thread> threads;
  for (auto& other : others) threads.emplace_back([&] { other = makePages(scene.picture, scene.triangles, 256); });
  for (std::thread& thread : threads) thread.join();
  for (const auto& other : others) {
    ASSERT_EQ(other.size(), pages.size());
    for (std::size_t i = 0; i < pages.size(); ++i) EXPECT_TRUE(same(other[i], pages[i]));
  }
}

}  // namespace
}  // namespace lod::texture
