#include "client/render/choose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>

#include "client/render/box_index.h"
#include "repository/sampling/cube_face.h"
#include "tests/client/render/ray_scene.h"

namespace {

using client::SampleGeometry;

base::Camera cameraAt(const glm::vec3& eye, const glm::vec3& target, int size, float fov_degrees) {
  return testing_scene::lookAt(eye, target, size, size, fov_degrees);
}

struct Samples {
  std::deque<SampleGeometry> geometry;
  std::vector<const SampleGeometry*> pointers;
  void add(const base::Camera& camera, float core = 1.0F) {
    geometry.emplace_back(camera, core);
    pointers.push_back(&geometry.back());
  }
};

const base::Aabb kBox{glm::vec3(-0.5F), glm::vec3(0.5F)};

std::vector<std::size_t> choose(const Samples& samples, const base::Camera& view, std::size_t limit) {
  const client::ProxyError error{0.001F, 0.1F};
  return client::chooseSamples(samples.pointers, std::span(&kBox, 1), std::span(&error, 1), view, limit, {});
}

TEST(ChooseSamples, theNearestRayComesFirst) {
  Samples samples;
  samples.add(cameraAt({0, 4, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({4, 0.2F, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({3, 3, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90), 3), (std::vector<std::size_t>{1, 2, 0}));
}

TEST(ChooseSamples, samplesThatLookElsewhereAreLeftOut) {
  Samples samples;
  samples.add(cameraAt({4, 0, 0}, {8, 0, 0}, 256, 90));
  samples.add(cameraAt({0, 4, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90), 3), (std::vector<std::size_t>{1}));
}

TEST(ChooseSamples, atTheSameAngleTheSharperOneComesFirst) {
  Samples samples;
  samples.add(cameraAt({4, 1, 0}, glm::vec3(0.0F), 64, 90));
  samples.add(cameraAt({4, -1, 0}, glm::vec3(0.0F), 256, 90));
  EXPECT_EQ(choose(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 512, 60), 1), (std::vector<std::size_t>{1}));
}

/// Chooses for places, each seen by the samples of its list.
std::vector<std::size_t> chooseSeen(const Samples& samples, const base::Camera& view, std::size_t limit,
                                    std::vector<glm::vec3> places,
                                    const std::vector<std::vector<std::size_t>>& seen_by) {
  const client::ProxyError error{0.001F, 0.1F};
  const client::VisibleSurface surface{std::move(places), [&](const glm::vec3& eye, std::size_t place) {
                                         return std::any_of(
                                             seen_by[place].begin(), seen_by[place].end(),
                                             [&](std::size_t s) { return samples.geometry[s].eye == eye; });
                                       }};
  return client::chooseSamples(samples.pointers, std::span(&kBox, 1), std::span(&error, 1), view, limit, {}, &surface);
}

TEST(ChooseSamples, oneWhoseWayIsBlockedComesAfterOneThatSeesThePlace) {
  Samples samples;
  samples.add(cameraAt({4, 0.2F, 0}, glm::vec3(0.0F), 256, 90));  // the nearest ray, behind a wall
  samples.add(cameraAt({3, 3, 0}, glm::vec3(0.0F), 256, 90));
  const base::Camera view = cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90);
  EXPECT_EQ(choose(samples, view, 1), (std::vector<std::size_t>{0}));
  EXPECT_EQ(chooseSeen(samples, view, 1, {glm::vec3(0.0F)}, {{1}}), (std::vector<std::size_t>{1}));
  EXPECT_EQ(chooseSeen(samples, view, 2, {glm::vec3(0.0F)}, {{1}}), (std::vector<std::size_t>{1, 0}))
      << "a coarse model errs, so that what is left goes to the box's images";
}

TEST(ChooseSamples, theBestOfFewPlacesIsWorthMoreThanAFarOneOfMany) {
  // A wall of places, most of which the first two see well; the last is seen by the third alone.
  Samples samples;
  samples.add(cameraAt({4, 0.2F, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({4, -0.3F, 0}, glm::vec3(0.0F), 256, 90));
  samples.add(cameraAt({3, 3, 0}, glm::vec3(0.0F), 256, 90));
  std::vector<glm::vec3> places;
  std::vector<std::vector<std::size_t>> seen_by;
  for (int i = 0; i < 20; ++i) {
    places.emplace_back(0.0F, 0.02F * static_cast<float>(i) - 0.2F, 0.0F);
    seen_by.push_back(i < 19 ? std::vector<std::size_t>{0, 1} : std::vector<std::size_t>{2});
  }
  const auto chosen = chooseSeen(samples, cameraAt({4, 0, 0}, glm::vec3(0.0F), 256, 90), 4, places, seen_by);
  ASSERT_EQ(chosen.size(), 3U);
  EXPECT_EQ(chosen[1], 2U) << "the second best of 19 places adds less";
}

/// Numbers 0 … 1 that are the same everywhere.
class Numbers {
 public:
  float next() {
    state_ = state_ * 1664525U + 1013904223U;
    return static_cast<float>(state_ >> 8U) / 16777216.0F;
  }
  glm::vec3 point() {
    const float x = next(), y = next(), z = next();
    return {x, y, z};
  }

 private:
  std::uint32_t state_ = 7;
};

std::vector<base::Aabb> makeBoxes(Numbers& numbers, int count) {
  std::vector<base::Aabb> boxes;
  for (int i = 0; i < count; ++i) {
    const glm::vec3 low = 2.0F * numbers.point() - 1.0F;
    boxes.push_back({low, low + 0.1F * numbers.point()});
  }
  return boxes;
}

TEST(BoxIndex, findsWhatTestingEachBoxFinds) {
  Numbers numbers;
  const std::vector<base::Aabb> boxes = makeBoxes(numbers, 500);
  const client::BoxIndex index(boxes);
  std::vector<std::uint32_t> found;
  std::size_t all = 0;
  for (int i = 0; i < 50; ++i) {
    const glm::vec3 eye = 4.0F * numbers.point() - 2.0F;
    const base::Frustum frustum(cameraAt(eye, numbers.point(), 64, 10.0F + 80.0F * numbers.next()).clipFromScene());
    std::vector<std::uint32_t> expected;
    for (std::uint32_t b = 0; b < boxes.size(); ++b)
      if (frustum.mayOverlap(boxes[b])) expected.push_back(b);
    index.findOverlapping(frustum, found);
    EXPECT_EQ(found, expected) << i;
    all += expected.size();
  }
  EXPECT_GT(all, 500U);
  EXPECT_LT(all, 15'000U);
}

/// Chooses like chooseSamples() does, with every gain computed anew for every choice, where no sample lies in another.
std::vector<std::size_t> chooseTheLongWay(const Samples& samples, const std::vector<base::Aabb>& boxes, float error,
                                          const base::Camera& view, std::size_t limit) {
  const auto weightIn = [&](std::size_t s, const base::Aabb& box) {
    if (!samples.geometry[s].frustum.mayOverlap(box)) return 0.0F;
    const float radius = 0.5F * box.diagonal() + 1e-20F;
    const glm::vec3 to_view = view.towardsViewer(box.center());
    const float distance = std::max(glm::length(to_view), radius);
    const glm::vec3 to_sample = samples.geometry[s].eye - box.center();
    const float sample_distance = std::max(glm::length(to_sample), radius);
    const float ratio =
        samples.geometry[s].pixels_per_unit_at_one / sample_distance / (view.pixelsPerUnitAtOne() / distance);
    return client::sampleWeight(to_view, to_sample, ratio, error * view.pixelsPerUnitAtOne() / distance, {});
  };
  std::vector<float> had(boxes.size(), 0.0F);
  std::vector<std::size_t> chosen;
  while (chosen.size() < limit) {
    std::vector<float> gains(samples.geometry.size(), 0.0F);
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      float best = 0.0F;
      for (std::size_t s = 0; s < gains.size(); ++s) best = std::max(best, weightIn(s, boxes[b]));
      const float size = (0.5F * boxes[b].diagonal()) / glm::length(view.towardsViewer(boxes[b].center()));
      for (std::size_t s = 0; s < gains.size() && best > 0.0F; ++s)
        gains[s] += size * size * weightIn(s, boxes[b]) / best / (0.3F + had[b]);
      for (const std::size_t s : chosen) gains[s] = 0.0F;
    }
    const auto most = std::max_element(gains.begin(), gains.end());
    if (*most <= 0.0F) break;
    chosen.push_back(static_cast<std::size_t>(most - gains.begin()));
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      float best = 0.0F;
      for (std::size_t s = 0; s < gains.size(); ++s) best = std::max(best, weightIn(s, boxes[b]));
      if (best > 0.0F) had[b] += weightIn(chosen.back(), boxes[b]) / best;
    }
  }
  return chosen;
}

TEST(ChooseSamples, choosesWholeFacesAsIfEveryGainWereComputedEveryTime) {
  Numbers numbers;
  const std::vector<base::Aabb> boxes = makeBoxes(numbers, 60);
  const std::vector<client::ProxyError> errors(boxes.size(), {0.002F, 0.1F});
  Samples samples;
  for (int i = 0; i < 5; ++i) {
    const glm::vec3 eye = 6.0F * numbers.point() - 3.0F;
    for (const glm::vec3 d : {glm::vec3(1, 0, 0), glm::vec3(-1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, -1, 0),
                              glm::vec3(0, 0, 1), glm::vec3(0, 0, -1)})
      samples.add(cameraAt(eye, eye + d, 256, 90));
  }
  for (int i = 0; i < 5; ++i) {
    const base::Camera view = cameraAt(6.0F * numbers.point() - 3.0F, glm::vec3(0.0F), 480, 50);
    const auto expected = chooseTheLongWay(samples, boxes, 0.002F, view, 10);
    EXPECT_GE(expected.size(), 5U);
    EXPECT_EQ(client::chooseSamples(samples.pointers, boxes, errors, view, 10, {}), expected) << i;
  }
}

// A wall of 32 × 32 boxes at x = 4, which fills the face +x of the point (0, 0, 0) in part, and its tiles.
class ChooseTiles : public ::testing::Test {
 protected:
  void SetUp() override {
    for (int i = 0; i < 1024; ++i) {
      const glm::vec3 low(4.0F, 0.25F * static_cast<float>(i % 32) - 4.0F, 0.25F * static_cast<float>(i / 32) - 4.0F);
      boxes.push_back({low, low + glm::vec3(0.01F, 0.25F, 0.25F)});
    }
    grid.first = glm::vec3(0.0F);
    grid.count = glm::uvec3(2);
    grid.face_size = 256;
    grid = repository::withTiles(grid, 3);
  }
  std::size_t addTile(const repository::TilePlace& place) {
    const repository::FaceKey key{0, 0, 0, 0, repository::tileAt(place)};
    samples.add(repository::faceCamera(grid, key, {glm::vec3(4.0F, 0, 0), 6.0F}), 248.0F / 256.0F);
    return samples.pointers.size() - 1;
  }
  std::vector<std::size_t> chooseFor(int view_size, std::size_t limit = 16, std::size_t more = 0) const {
    const std::vector<client::ProxyError> errors(boxes.size(), {0.001F, 0.1F});
    return client::chooseSamples(samples.pointers, boxes, errors, cameraAt({0.1F, 0.1F, 0}, {4, 0, 0}, view_size, 80),
                                 limit, {}, nullptr, more);
  }
  static bool has(const std::vector<std::size_t>& chosen, std::size_t sample) {
    return std::find(chosen.begin(), chosen.end(), sample) != chosen.end();
  }
  std::vector<base::Aabb> boxes;
  repository::Grid grid;
  Samples samples;
};

TEST_F(ChooseTiles, moreComeOfThePointThatHasMany) {
  for (std::uint32_t y = 0; y < 4; ++y)
    for (std::uint32_t x = 0; x < 4; ++x) addTile({2, x, y});
  const std::size_t other = samples.pointers.size();
  for (int i = 0; i < 4; ++i) samples.add(cameraAt({0, 0.5F * static_cast<float>(i), -3}, {4, 0, -3}, 256, 90));
  const auto best = chooseFor(1000, 8);
  ASSERT_EQ(best.size(), 8U);
  const auto with_more = chooseFor(1000, 8, 5);
  ASSERT_EQ(with_more.size(), 13U);
  EXPECT_TRUE(std::equal(best.begin(), best.end(), with_more.begin())) << "they come behind the best";
  for (std::size_t i = 8; i < with_more.size(); ++i)
    EXPECT_LT(with_more[i], other) << "of a point that has at most one";
  const auto of_others = std::count_if(best.begin(), best.end(), [&](std::size_t s) { return s >= other; });
  EXPECT_EQ(chooseFor(1000, 8, 100).size(), 16U + static_cast<std::size_t>(of_others))
      << "all of it, no more of others";
}

TEST_F(ChooseTiles, oneThatLiesUnderFinerOnesIsNotChosen) {
  const std::size_t coarse = addTile({0, 0, 0});
  for (const std::uint32_t y : {0U, 1U})
    for (const std::uint32_t x : {0U, 1U}) addTile({1, x, y});
  samples.add(cameraAt({0, 0, -3}, {4, 0, -3}, 256, 90));  // worse, but of another point
  const auto chosen = chooseFor(1000);
  EXPECT_EQ(chosen.size(), 5U);
  EXPECT_FALSE(has(chosen, coarse));
  EXPECT_EQ(chosen.back(), 5U);
}

TEST_F(ChooseTiles, oneThatShowsWhatNoFinerOneDoesIsChosen) {
  const std::size_t coarse = addTile({0, 0, 0});
  for (const std::uint32_t y : {0U, 1U})
    for (const std::uint32_t x : {0U, 1U})
      if (x + y < 2) addTile({1, x, y});
  EXPECT_TRUE(has(chooseFor(1000), coarse));
}

TEST_F(ChooseTiles, finerOnesAreNotChosenForAViewThatTheCoarserOneResolves) {
  for (const std::uint32_t y : {0U, 1U})
    for (const std::uint32_t x : {0U, 1U}) addTile({1, x, y});
  const std::size_t coarse = addTile({0, 0, 0});
  EXPECT_EQ(chooseFor(100), (std::vector<std::size_t>{coarse}));
}

TEST_F(ChooseTiles, aMixtureOfDepthsLeavesOutWhatIsCoveredAtAnyDepth) {
  const std::size_t whole = addTile({0, 0, 0});
  const std::size_t covered = addTile({1, 0, 0});
  for (const std::uint32_t y : {0U, 1U})
    for (const std::uint32_t x : {0U, 1U}) addTile({2, x, y});
  addTile({1, 1, 0});
  addTile({1, 0, 1});
  addTile({1, 1, 1});
  const auto chosen = chooseFor(2000);
  EXPECT_EQ(chosen.size(), 7U);
  EXPECT_FALSE(has(chosen, whole) || has(chosen, covered));
}

}  // namespace
