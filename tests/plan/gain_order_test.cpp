#include "plan/gain_order.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/geometry.h"
#include "repository/sampling/cube_face.h"

namespace plan {
namespace {

/// A wall at x = 4 before an eye at the middle of a grid of 3 × 3 × 3 points, seen by a camera of 600 pixels a radian.
class GainOrders : public ::testing::Test {
 protected:
  GainOrders() {
    base::Aabb box;
    box.add(glm::vec3(-4.0F));
    box.add(glm::vec3(4.0F));
    query_.points.grid = repository::withTiles(repository::makeGrid(box, 3, 0.0F, 512), 4);
    query_.points.pixels_per_unit_at_one = 600.0F;
    query_.points.eye = glm::vec3(-0.5F, 0.0F, 0.0F);
    for (int y = -10; y <= 10; ++y)
      for (int z = -6; z <= 6; ++z)
        samples_.push_back({glm::vec3(4.0F, 0.15F * static_cast<float>(y), 0.15F * static_cast<float>(z)),
                            glm::vec3(-1.0F, 0.0F, 0.0F), 1.0F / 273.0F});
  }
  std::vector<OrderedItem> choose(float color_error = 0.1F) {
    const std::vector<ProxyPlace> places(samples_.size(), ProxyPlace{{color_error, 0.001F}, {}, color_error});
    return orderByGain(query_, points_, samples_, places, {}).items;
  }
  static std::uint32_t depthOf(const OrderedItem& item) { return repository::placeOfTile(item.image->tile).depth; }

  GainQuery query_;
  std::vector<glm::uvec3> points_{{1, 1, 1}};
  std::vector<SurfaceSample> samples_;
};

TEST_F(GainOrders, goDownToThePixelsOfTheViewAndNoFurther) {
  std::uint32_t deepest = 0;
  for (const OrderedItem& tile : choose()) deepest = std::max(deepest, depthOf(tile));
  // 600 / 4.5 view pixels a unit; a face of 248 · 2^l pixels has 124 · 2^l / 4 of them, so l = 3 is the first with
  // more.
  EXPECT_EQ(deepest, 3U);
}

TEST_F(GainOrders, everyPlaceIsShownAtTheFinestDepthInTheEnd) {
  const auto tiles = choose();
  for (const SurfaceSample& sample : samples_) {
    const auto key = repository::tileOfDirection(sample.position - query_.points.grid.point(1, 1, 1), 3);
    EXPECT_TRUE(std::any_of(tiles.begin(), tiles.end(), [&](const OrderedItem& tile) {
      return tile.image == repository::FaceKey{1, 1, 1, key.d, key.tile};
    }));
  }
}

TEST_F(GainOrders, gainsAreOfErrorsAndFall) {
  const auto tiles = choose();
  ASSERT_FALSE(tiles.empty());
  float sum = 0.0F;
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    sum += tiles[i].gain;
    if (i > 0) {
      EXPECT_LE(tiles[i].gain, tiles[i - 1].gain * 1.001F);
    }
  }
  EXPECT_LE(sum, 0.1F * 0.1F);
  EXPECT_GT(sum, 0.3F * 0.1F * 0.1F);
}

TEST_F(GainOrders, aProxyThatErrsNoMoreThanImagesNeedsNone) {
  EXPECT_TRUE(choose(0.005F).empty());
}

TEST_F(GainOrders, imagesOfShadowsGainHoweverFineTheProxyIs) {
  query_.lacking2 = 0.01F;
  const auto tiles = choose(0.005F);
  ASSERT_FALSE(tiles.empty());
  EXPECT_TRUE(std::any_of(tiles.begin(), tiles.end(), [](const OrderedItem& tile) { return depthOf(tile) == 3; }));
  float sum = 0.0F;
  for (const OrderedItem& tile : tiles) sum += tile.gain;
  EXPECT_GT(sum, 0.005F);
}

TEST_F(GainOrders, aModelThatIsSmallInThePictureGetsItsImages) {
  query_.image_bytes = 30'000;
  const std::size_t of_a_full_picture = choose(0.02F).size();
  ASSERT_GT(of_a_full_picture, 4U);
  for (SurfaceSample& sample : samples_) sample.weight *= 0.25F;
  EXPECT_EQ(choose(0.02F).size(), of_a_full_picture);
  query_.counts_foreground = false;
  EXPECT_LT(choose(0.02F).size(), of_a_full_picture) << "while the eye moves on";
  query_.counts_foreground = true;
  for (SurfaceSample& sample : samples_) sample.weight *= 0.25F;
  EXPECT_LT(choose(0.02F).size(), of_a_full_picture) << "a quarter is the least";
}

TEST_F(GainOrders, tilesThatAreHereAreNotSentAndLessenWhatOthersGain) {
  const auto all = choose();
  query_.is_here = [&](const repository::FaceKey& key) { return key == all.front().image; };
  const auto rest = choose();
  EXPECT_LT(rest.size(), all.size() + 1);
  for (const OrderedItem& tile : rest) EXPECT_NE(tile.image, all.front().image);
}

TEST_F(GainOrders, theAncestorOfAnAbsentTileStandsForIt) {
  query_.stored_bytes = [](const repository::FaceKey& key) -> std::optional<std::uint64_t> {
    return repository::placeOfTile(key.tile).depth > 1 ? std::optional<std::uint64_t>(0) : std::nullopt;
  };
  const auto tiles = choose();
  ASSERT_FALSE(tiles.empty());
  float sum = 0.0F;
  for (const OrderedItem& tile : tiles) {
    EXPECT_LE(depthOf(tile), 1U);
    sum += tile.gain;
  }
  EXPECT_GT(sum, 0.3F * 0.1F * 0.1F) << "it shows all there is to see";
}

TEST_F(GainOrders, ofTilesThatGainTheSameTheOneOfFewerBytesComesFirst) {
  const auto before = choose();
  ASSERT_GT(before.size(), 4U);
  const repository::FaceKey small = *before.back().image;
  query_.stored_bytes = [&](const repository::FaceKey& key) -> std::optional<std::uint64_t> {
    return key == small ? std::optional<std::uint64_t>(10) : std::nullopt;
  };
  EXPECT_EQ(choose().front().image, small);
  // One that costs a thousand times as much is not worth its bytes.
  query_.stored_bytes = [&](const repository::FaceKey& key) -> std::optional<std::uint64_t> {
    return key == small ? std::optional<std::uint64_t>(10'000'000) : std::nullopt;
  };
  for (const OrderedItem& item : choose()) EXPECT_NE(item.image, small);
}

TEST_F(GainOrders, noMoreThanAskedFor) {
  query_.max_images = 3;
  EXPECT_EQ(choose().size(), 3U);
}

/// The wall's left and right halves are refined by a group each, after one of both.
class GainOrdersOfGroups : public GainOrders {
 protected:
  std::vector<OrderedItem> choose(float left, float right, std::uint64_t bytes = 20'000) {
    groups_ = {group(1000, {}), group(bytes, {0}), group(bytes, {0})};
    groups_[1].is_needed = groups_[2].is_needed = is_needed_;
    std::vector<ProxyPlace> places;
    for (const SurfaceSample& sample : samples_) {
      const bool is_left = sample.position.y < 0.0F;
      const float color = is_left ? left : right;
      places.push_back({{0.3F, 0.1F}, {{0, {0.2F, 0.03F}}, {is_left ? 1U : 2U, {color, 0.001F}}}, color});
    }
    return orderByGain(query_, points_, samples_, places, groups_).items;
  }
  static OrderedGroup group(std::uint64_t bytes, std::vector<std::size_t> parents) {
    OrderedGroup group;
    group.bytes = bytes;
    group.parents = std::move(parents);
    group.before = {0.2F, 0.001F}, group.after = {0.02F, 0.001F};
    group.share = 0.5F;
    group.density = 100.0F;
    return group;
  }
  static std::size_t placeOf(const std::vector<OrderedItem>& items, std::size_t group) {
    const auto found =
        std::find_if(items.begin(), items.end(), [&](const auto& i) { return !i.image && i.group == group; });
    return static_cast<std::size_t>(found - items.begin());
  }
  std::vector<OrderedGroup> groups_;
  bool is_needed_ = true;
};

TEST_F(GainOrdersOfGroups, allComeOnceParentsFirst) {
  for (const float left : {0.01F, 0.1F, 0.2F}) {
    const auto items = choose(left, 0.1F);
    EXPECT_EQ(std::count_if(items.begin(), items.end(), [](const auto& item) { return !item.image; }), 3);
    EXPECT_LT(placeOf(items, 0), placeOf(items, 1));
    EXPECT_LT(placeOf(items, 0), placeOf(items, 2));
  }
}

TEST_F(GainOrdersOfGroups, theOneThatGainsMoreComesFirst) {
  const auto left = choose(0.02F, 0.15F);
  EXPECT_LT(placeOf(left, 1), placeOf(left, 2));
  const auto right = choose(0.15F, 0.02F);
  EXPECT_LT(placeOf(right, 2), placeOf(right, 1));
}

TEST_F(GainOrdersOfGroups, thoseThatOnlyBringColoursStayWhereTheyGainTooLittleForTheirBytes) {
  const auto has = [](const std::vector<OrderedItem>& items, std::size_t group) {
    return placeOf(items, group) < items.size();
  };
  is_needed_ = false;
  EXPECT_TRUE(has(choose(0.02F, 0.15F), 1));
  EXPECT_TRUE(has(choose(0.02F, 0.2F, 30'000'000), 1));
  EXPECT_FALSE(has(choose(0.02F, 0.2F, 300'000'000), 2)) << "its colours are no better than those that are there";
  is_needed_ = true;
  EXPECT_TRUE(has(choose(0.02F, 0.2F, 300'000'000), 2));
  is_needed_ = false;
  query_.leaves_groups = false;
  const auto all = choose(0.02F, 0.2F, 300'000'000);
  EXPECT_EQ(placeOf(all, 2), all.size() - 1) << "behind all else";
}

TEST_F(GainOrdersOfGroups, coloursGainLittleBeneathImagesWhereTheShapeServes) {
  choose(0.12F, 0.12F);
  const std::vector<ProxyPlace> places(samples_.size(), {{0.2F, 0.001F}, {{0, {0.12F, 0.001F}}}, 0.02F});
  points_.emplace_back(1, 0, 1);
  query_.is_here = [](const repository::FaceKey&) { return true; };
  query_.leaves_groups = false;
  const auto gain = [&](bool is_needed) {
    groups_[0].is_needed = is_needed;
    const auto items = orderByGain(query_, points_, samples_, places, groups_).items;
    return items.at(placeOf(items, 0)).gain;
  };
  const float needed = gain(true);
  EXPECT_GT(needed, 0.0F);
  EXPECT_LT(gain(false), 0.1F * needed) << "images lie where they lay";
  query_.is_here = [](const repository::FaceKey&) { return false; };
  query_.max_images = 0;
  EXPECT_FLOAT_EQ(gain(false), gain(true)) << "without images they gain what the proxy errs less";
  EXPECT_GT(gain(false), 2.0F * needed);
}

TEST_F(GainOrdersOfGroups, imagesComeBeforeThoseThatCostTooMuch) {
  const auto cheap = choose(0.01F, 0.01F, 2'000);
  EXPECT_EQ(placeOf(cheap, 1) + placeOf(cheap, 2), 3U) << "then images have nothing to add to them";
  const auto dear = choose(0.01F, 0.01F, 10'000'000);
  EXPECT_EQ(placeOf(dear, 1) + placeOf(dear, 2), 2 * dear.size() - 3) << "last of all";
  EXPECT_GT(dear.size(), cheap.size());
}

TEST_F(GainOrdersOfGroups, comeEarlierTheMoreOfLaterViewsCounts) {
  const auto places = [&](float share) {
    query_.later_share = share;
    const auto items = choose(0.1F, 0.1F, 50'000);
    return placeOf(items, 1) + placeOf(items, 2);
  };
  const std::size_t now = places(0.0F), a_tenth = places(0.1F), all = places(1.0F);
  EXPECT_GT(now, a_tenth);
  EXPECT_GE(a_tenth, all);
}

TEST_F(GainOrdersOfGroups, gainsAreWhatTheExpectedErrorLoses) {
  choose(0.02F, 0.1F);
  std::vector<ProxyPlace> places(samples_.size(), {{0.3F, 0.1F}, {{0, {0.2F, 0.03F}}}, 0.2F});
  const OrderByGain order = orderByGain(query_, points_, samples_, places, groups_);
  float gains = 0.0F;
  for (const OrderedItem& item : order.items) gains += item.gain;
  EXPECT_LT(order.error_after, 0.3F * order.error_before);
  EXPECT_NEAR(gains, order.error_before - order.error_after, 1e-4F * order.error_before);
}

TEST_F(GainOrdersOfGroups, aGroupThatOnlyMakesAnotherPossibleIsWorthItsBytes) {
  groups_ = {group(1000, {}), group(1000, {0}), group(1000, {})};
  std::vector<ProxyPlace> places;
  for (const SurfaceSample& sample : samples_)
    if (sample.position.y < 0.0F)
      places.push_back({{0.2F, 0.001F}, {{0, {0.2F, 0.001F}}, {1, {0.01F, 0.001F}}}});
    else
      places.push_back({{0.2F, 0.001F}, {{2, {0.15F, 0.001F}}}});
  query_.max_images = 0;
  const auto items = orderByGain(query_, points_, samples_, places, groups_).items;
  ASSERT_EQ(items.size(), 3U);
  EXPECT_EQ(items[0].group, 0U);
  EXPECT_EQ(items[1].group, 1U);
  EXPECT_EQ(items[2].group, 2U);
}

TEST(TileOfDirection, isTheTileWhoseCameraSeesIt) {
  base::Aabb box;
  box.add(glm::vec3(-1.0F));
  box.add(glm::vec3(1.0F));
  const auto grid = repository::withTiles(repository::makeGrid(box, 2, 0.0F, 512), 3);
  const base::Sphere scene{glm::vec3(0.0F), 10.0F};
  for (int i = 0; i < 500; ++i) {
    const float a = 0.37F * static_cast<float>(i);
    const glm::vec3 direction(std::sin(a), std::cos(1.7F * a), std::sin(2.3F * a + 1.0F));
    for (std::uint32_t depth = 0; depth <= 3; ++depth) {
      const repository::FaceKey key = repository::tileOfDirection(direction, depth);
      const base::Camera camera = repository::faceCamera(grid, key, scene);
      const glm::vec4 clip = camera.clipFromScene() * glm::vec4(camera.eye + direction, 1.0F);
      const float core = static_cast<float>(repository::kTileCore) / static_cast<float>(repository::kTileSide) + 1e-4F;
      ASSERT_GT(clip.w, 0.0F);
      EXPECT_LE(std::abs(clip.x / clip.w), core);
      EXPECT_LE(std::abs(clip.y / clip.w), core);
    }
  }
}

}  // namespace
}  // namespace plan
