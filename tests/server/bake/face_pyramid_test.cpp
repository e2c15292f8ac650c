#include "server/bake/face_pyramid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "server/bake/face_encoder.h"

namespace server {
namespace {

using repository::childOfTile;
using repository::kTileSide;
using repository::tileAt;

using Rgba = std::array<std::uint8_t, 4>;

void paint(base::Image& image, int left, int top, int width, int height, const Rgba& colour) {
  for (int y = top; y < top + height; ++y)
    for (int x = left; x < left + width; ++x) std::copy(colour.begin(), colour.end(), image.at(x, y));
}

base::Image faceOf(std::uint32_t depth) {
  const int side = static_cast<int>(kTileSide << depth);
  return {side, side, 4};
}

// Squares of one pixel, by turns light and dark.
void paintChequers(base::Image& image, int left, int top, int width, int height) {
  for (int y = top; y < top + height; ++y)
    for (int x = left; x < left + width; ++x) {
      const std::uint8_t grey = (x + y) % 2 == 0 ? 200 : 40;
      paint(image, x, y, 1, 1, {grey, grey, grey, 255});
    }
}

TEST(FacePyramid, halvingWeighsColoursByWhatTheyCover) {
  base::Image image = faceOf(1);
  paint(image, 0, 0, 1, 1, {200, 0, 0, 255});
  paint(image, 1, 0, 1, 1, {0, 100, 0, 85});
  paint(image, 0, 1, 1, 1, {255, 255, 255, 0});  // covers nothing, so it has no colour
  const base::Image half = FacePyramid(image, 1).imageOf(0);
  // (200 · 255) / 340 = 150, (100 · 85) / 340 = 25, and 340 / 4 = 85 of alpha.
  EXPECT_EQ(std::vector<std::uint8_t>(half.at(0, 0), half.at(0, 0) + 4), (std::vector<std::uint8_t>{150, 25, 0, 85}));
}

TEST(FacePyramid, aTileBeginsFourPixelsBeforeItsCore) {
  base::Image face = faceOf(2);
  // Depth 2 has a border of 16 pixels around its 4 × 4 cores of 248: that of the tile at (3, 1) begins at (760, 264).
  paint(face, 760, 264, 1, 1, {9, 8, 7, 255});
  const FacePyramid pyramid(face, 2);
  const base::Image tile = pyramid.imageOf(tileAt({2, 3, 1}));
  EXPECT_EQ(tile.width, 256);
  EXPECT_EQ(tile.at(4, 4)[0], 9);
  EXPECT_EQ(tile.at(3, 4)[3], 0);
  // Its neighbour on the left has that pixel in its border: 248 pixels further to the right.
  EXPECT_EQ(pyramid.imageOf(tileAt({2, 2, 1})).at(252, 4)[0], 9);
}

TEST(FacePyramid, aTileOfTheLevelAboveShowsTheSamePlaceAtHalfTheResolution) {
  base::Image face = faceOf(1);
  paint(face, 8 + 248, 8 + 100, 2, 2, {60, 70, 80, 255});
  const FacePyramid pyramid(face, 1);
  EXPECT_EQ(pyramid.imageOf(tileAt({1, 1, 0})).at(4, 104)[2], 80);
  const base::Image whole = pyramid.imageOf(0);
  EXPECT_EQ(std::vector<std::uint8_t>(whole.at(4 + 124, 4 + 50), whole.at(4 + 125, 4 + 50)),
            (std::vector<std::uint8_t>{60, 70, 80, 255}));
  EXPECT_EQ(whole.at(4 + 123, 4 + 50)[3], 0);
}

TEST(FacePyramid, evenSurfacesAreStoredOnce) {
  base::Image face = faceOf(3);
  paint(face, 0, 0, face.width, face.height, {120, 130, 140, 255});
  const FacePyramid pyramid(face, 3);
  EXPECT_EQ(pyramid.differenceFromParent(5), 0.0);
  EXPECT_EQ(chooseTiles(pyramid), (std::vector<ChosenTile>{{0, 0}}));
}

TEST(FacePyramid, emptyFacesAreOneTile) {
  const base::Image face = faceOf(2);
  EXPECT_EQ(chooseTiles(FacePyramid(face, 2)), (std::vector<ChosenTile>{{0, 0}}));
}

TEST(FacePyramid, facesWithoutPixelsOrWithFaintOnesAreEmpty) {
  base::Image faint = faceOf(1);
  for (std::size_t i = 3; i < faint.pixels.size(); i += 4) faint.pixels[i] = kStoredCoverage - 1;
  const FaceCoding coding{.tile_depth = 1, .codec = repository::ImageCodec::kWebp};
  for (const base::Image& image : {base::Image(), faint}) {
    const auto face = encodeFace(image, coding);
    ASSERT_TRUE(face);
    EXPECT_TRUE(face->empty);
    ASSERT_EQ(face->tiles.size(), 1U);
    EXPECT_EQ(face->tiles[0].tile, 0U);
    EXPECT_TRUE(repository::decodeFaceValue(face->tiles[0].value)->empty);
  }
}

// A picture with every kind of pixel: empty, faint, covered in part and as a whole, alone and side by side.
base::Image mixedFace(std::uint32_t depth) {
  base::Image face = faceOf(depth);
  std::mt19937 random(8);
  for (int y = 0; y < face.height; ++y)
    for (int x = 0; x < face.width; ++x) {
      const unsigned kind = (x / 37 + y / 23) % 5;
      if (kind < 2) continue;
      std::uint8_t* pixel = face.at(x, y);
      for (int c = 0; c < 3; ++c) pixel[c] = static_cast<std::uint8_t>(random());
      pixel[3] = kind == 2 ? 255 : kind == 3 ? static_cast<std::uint8_t>(random()) : random() % 3 == 0 ? 255 : 7;
    }
  return face;
}

TEST(FacePyramid, aDifferenceIsThatFromABilinearFilter) {
  const base::Image face = mixedFace(1);
  const FacePyramid pyramid(face, 1);
  const base::Image coarse = pyramid.imageOf(0);
  const auto channel = [](const base::Image& image, int x, int y, int c) {
    const std::uint8_t* pixel = image.at(x, y);
    return (c < 3 ? pixel[c] : 255) * pixel[3] / 255.0;
  };
  double squares = 0.0, pixels = 0.0;
  for (int y = 8; y < 256; ++y)
    for (int x = 8; x < 256; ++x) {
      double sum = 0.0, alphas = 0.0;
      for (int c = 0; c < 4; ++c) {
        // The finer pixel's centre in pixels of the coarser level, and the four centres around it.
        const double u = 0.5 * (x + 0.5) - 0.5, v = 0.5 * (y + 0.5) - 0.5;
        const int i = static_cast<int>(std::floor(u)), j = static_cast<int>(std::floor(v));
        double shown = 0.0;
        for (int k = 0; k < 4; ++k)
          shown +=
              std::abs(1 - k % 2 - (u - i)) * std::abs(1 - k / 2 - (v - j)) * channel(coarse, i + k % 2, j + k / 2, c);
        const double own = channel(face, x, y, c);
        sum += (own - shown) * (own - shown);
        if (c == 3) alphas = own + shown;
      }
      if (alphas == 0.0) continue;
      squares += sum, ++pixels;
    }
  EXPECT_NEAR(pyramid.differenceFromParent(1), std::sqrt(squares / (4.0 * pixels)), 1e-9);
}

TEST(FacePyramid, aTileShowsModelWhereAnyOfItsPixelsDoes) {
  // One pixel at a time, at the corners of tiles' images and beside them.
  for (const std::uint8_t alpha : {kStoredCoverage, static_cast<std::uint8_t>(kStoredCoverage - 1)})
    for (const auto& [x, y] : {std::pair(4, 4), std::pair(3, 4), std::pair(259, 259), std::pair(260, 100),
                               std::pair(252, 252), std::pair(251, 252), std::pair(507, 507), std::pair(508, 300)}) {
      base::Image face = faceOf(1);
      face.at(x, y)[3] = alpha;
      const FacePyramid pyramid(face, 1);
      for (std::uint32_t tile = 1; tile < 5; ++tile) {
        const base::Image image = pyramid.imageOf(tile);
        EXPECT_EQ(pyramid.showsModel(tile), showsModel(image)) << x << ' ' << y << ' ' << tile;
      }
    }
  const base::Image face = mixedFace(2);
  const FacePyramid pyramid(face, 2);
  for (std::uint32_t tile = 0; tile < 21; ++tile)
    EXPECT_EQ(pyramid.showsModel(tile), showsModel(pyramid.imageOf(tile)));
}

TEST(FacePyramid, detailIsStoredWithAllThatLeadToIt) {
  base::Image face = faceOf(2);
  paint(face, 0, 0, face.width, face.height, {120, 120, 120, 255});
  paintChequers(face, 16 + 248 * 2 + 20, 16 + 248 * 3 + 20, 200, 200);  // within the tile (2, 3) of depth 2
  const std::uint32_t finest = tileAt({2, 2, 3});
  const std::uint32_t parent = tileAt({1, 1, 1});
  ASSERT_EQ(finest, childOfTile(parent, 2));
  ASSERT_EQ(parent, childOfTile(0, 3));
  EXPECT_EQ(chooseTiles(FacePyramid(face, 2)), (std::vector<ChosenTile>{{0, 1 << 3}, {parent, 1 << 2}, {finest, 0}}));
}

TEST(FacePyramid, tilesThatAreNotWantedAreLeftOut) {
  base::Image face = faceOf(2);
  paintChequers(face, 0, 0, face.width, face.height);
  EXPECT_EQ(chooseTiles(FacePyramid(face, 2)).size(), 21U);
  const std::vector<std::uint32_t> wanted{0, 2, childOfTile(2, 1)};
  const auto chosen = chooseTiles(FacePyramid(face, 2), kTileThreshold, &wanted);
  EXPECT_EQ(chosen, (std::vector<ChosenTile>{{0, 1 << 1}, {2, 1 << 1}, {childOfTile(2, 1), 0}}));
  const std::vector<std::uint32_t> first{0};
  EXPECT_EQ(chooseTiles(FacePyramid(face, 2), kTileThreshold, &first), (std::vector<ChosenTile>{{0, 0}}));
}

TEST(FacePyramid, aChequersDifferenceFromItsMeanIsItsAmplitude) {
  base::Image face = faceOf(1);
  paintChequers(face, 0, 0, face.width, face.height);
  const FacePyramid pyramid(face, 1);
  // Colours of 200 and 40 become 120: three of the four channels differ by 80, so 80 · √¾.
  EXPECT_NEAR(pyramid.differenceFromParent(2), 80.0 * std::sqrt(0.75), 1e-9);
  EXPECT_EQ(chooseTiles(pyramid, 69.2).size(), 5U);
  EXPECT_EQ(chooseTiles(pyramid, 69.3).size(), 1U);
}

// A line of one pixel covers a quarter of the coarsest tile's pixels, which are model all the same.
TEST(FacePyramid, thinLinesAreModelAtEveryDepth) {
  base::Image face = faceOf(2);
  paint(face, 16 + 300, 16, 1, 992, {250, 10, 10, 255});
  const auto coded = encodeFace(face, {85, base::Subsampling::k444, 2});
  ASSERT_TRUE(coded);
  ASSERT_FALSE(coded->tiles.empty());
  EXPECT_FALSE(coded->empty);
  const auto whole = repository::decodeFaceValue(coded->tiles.front().value);
  ASSERT_TRUE(whole);
  EXPECT_EQ(whole->children, 0b0101);
  EXPECT_FALSE(whole->empty);
  const auto mask = repository::decodeCoverage(whole->coverage, 256, 256);
  ASSERT_TRUE(mask);
  EXPECT_EQ(std::count(mask->pixels.begin(), mask->pixels.end(), 255), 248);
  // Four tiles of depth 2 below one another hold the line at its full width.
  const auto finest = std::count_if(coded->tiles.begin(), coded->tiles.end(),
                                    [](const EncodedTile& t) { return repository::placeOfTile(t.tile).depth == 2; });
  EXPECT_EQ(finest, 4);
}

TEST(FacePyramid, encodedTilesNameTheirChildren) {
  base::Image face = faceOf(2);
  paintChequers(face, 16 + 400, 16 + 400, 200, 200);  // around the middle: a part of all four quarters
  const auto coded = encodeFace(face, {85, base::Subsampling::k420, 2});
  ASSERT_TRUE(coded);
  std::vector<ChosenTile> stored;
  std::uint64_t bytes = 0;
  for (const EncodedTile& tile : coded->tiles) {
    const auto value = repository::decodeFaceValue(tile.value);
    ASSERT_TRUE(value);
    const auto picture = base::decodeJpeg(value->picture);
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->width, 256);
    stored.push_back({tile.tile, value->children});
    bytes += tile.value.size();
  }
  EXPECT_EQ(stored, chooseTiles(FacePyramid(face, 2)));
  EXPECT_EQ(stored.size(), 9U);
  EXPECT_EQ(coded->valueBytes(), bytes);
}

TEST(FacePyramid, webpHoldsThePixelsAndTheMaskThatJpegHolds) {
  base::Image face = faceOf(2);
  paintChequers(face, 16 + 400, 16 + 400, 200, 200);
  const auto jpeg = encodeFace(face, {95, base::Subsampling::k444, 2});
  const auto webp = encodeFace(face, {95, base::Subsampling::k444, 2, repository::ImageCodec::kWebp});
  ASSERT_TRUE(jpeg && webp);
  ASSERT_EQ(jpeg->tiles.size(), webp->tiles.size());
  EXPECT_EQ(webp->coverage_bytes, 0U);
  for (std::size_t i = 0; i < jpeg->tiles.size(); ++i) {
    const auto one = repository::decodeFaceValue(jpeg->tiles[i].value);
    const auto other = repository::decodeFaceValue(webp->tiles[i].value);
    ASSERT_TRUE(one && other);
    EXPECT_TRUE(repository::isWebp(other->picture));
    EXPECT_EQ(one->children, other->children);
    const auto a = repository::decodeFacePixels(jpeg->tiles[i].value, 256);
    const auto b = repository::decodeFacePixels(webp->tiles[i].value, 256);
    ASSERT_TRUE(a && b);
    EXPECT_EQ(a->mask.pixels, b->mask.pixels);
  }
}

}  // namespace
}  // namespace server
