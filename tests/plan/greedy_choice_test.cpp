#include "plan/greedy_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace plan {
namespace {

/// The formula of plan/point_choice.h, one point and one sample at a time.
float useByFormula(const PointQuery& query, const glm::vec3& point, const SurfaceSample& sample) {
  const glm::vec3 to_eye = query.eye - sample.position;
  const glm::vec3 to_point = point - sample.position;
  const float eye_distance = glm::length(to_eye);
  const float point_distance = glm::length(to_point);
  if (!(eye_distance > 0.0F) || !(point_distance > 0.0F)) return 0.0F;
  const float cosine = glm::dot(to_eye, to_point) / (eye_distance * point_distance);
  if (!(cosine > 0.0F)) return 0.0F;
  const float view_resolution = query.pixels_per_unit_at_one / eye_distance;
  const float face_resolution = 0.5F * static_cast<float>(query.grid.face_size) / point_distance;
  const float covers = std::max(1.0F, view_resolution / face_resolution);
  const float shift = kTypicalError * query.error_px * std::sqrt(std::max(0.0F, 1.0F - cosine * cosine)) / cosine;
  float facing = cosine;
  if (glm::dot(sample.normal, sample.normal) > 0.0F) {
    float towards_eye = glm::dot(sample.normal, to_eye) / eye_distance;
    float towards_point = glm::dot(sample.normal, to_point) / point_distance;
    if (towards_eye < 0.0F) towards_eye = -towards_eye, towards_point = -towards_point;
    facing = std::clamp(towards_point / std::max(towards_eye, 0.2F), 0.0F, 1.0F);
  }
  return facing / std::sqrt(covers * covers + shift * shift);
}

/// Looks at all items for each choice, and knows from the start what is hidden.
std::vector<ChosenItem> chooseAmongAll(const UseTable& uses, const std::vector<SurfaceSample>& samples,
                                       std::size_t limit) {
  std::vector<ChosenItem> chosen;
  std::vector<float> best(samples.size(), 0.0F), second(samples.size(), 0.0F);
  std::set<std::size_t> left;
  for (std::size_t i = 0; i < uses.items(); ++i) left.insert(i);
  while (chosen.size() < limit && !left.empty()) {
    ChosenItem next{*left.begin(), -1.0F};
    for (const std::size_t item : left) {
      float gain = 0.0F;
      for (std::size_t s = 0; s < samples.size(); ++s) {
        const float use = uses.at(item, s);
        const float more = use > best[s]     ? (use - best[s]) + 0.5F * (best[s] - second[s])
                           : use > second[s] ? 0.5F * (use - second[s])
                                             : 0.0F;
        gain += samples[s].weight * more;
      }
      if (gain > next.gain) next = {item, gain};
    }
    for (std::size_t s = 0; s < samples.size(); ++s) {
      const float use = uses.at(next.item, s);
      if (use > best[s]) {
        second[s] = best[s], best[s] = use;
      } else {
        second[s] = std::max(second[s], use);
      }
    }
    left.erase(next.item);
    chosen.push_back(next);
  }
  return chosen;
}

class Random {
 public:
  explicit Random(unsigned seed) : random_(seed) {}
  float unit() { return std::uniform_real_distribution<float>(0.0F, 1.0F)(random_); }
  glm::vec3 place() { return 8.0F * glm::vec3(unit(), unit(), unit()) - 4.0F; }
  std::size_t below(std::size_t count) { return random_() % count; }

 private:
  std::mt19937 random_;
};

std::vector<SurfaceSample> drawSamples(Random& random, std::size_t count) {
  std::vector<SurfaceSample> samples;
  for (std::size_t s = 0; s < count; ++s) {
    const bool has_normal = random.below(4) != 0;
    samples.push_back({random.place(), has_normal ? glm::normalize(random.place()) : glm::vec3(0.0F),
                       1.0F / static_cast<float>(count)});
  }
  return samples;
}

TEST(GreedyChoice, usesOfFourPointsAreThoseOfEach) {
  Random random(1);
  for (const std::size_t count : {1U, 3U, 4U, 30U}) {
    PointQuery query;
    query.grid.first = glm::vec3(-4.0F);
    query.grid.count = glm::uvec3(9);
    query.grid.face_size = 512;
    query.eye = random.place();
    query.pixels_per_unit_at_one = 700.0F;
    query.error_px = 1.5F;
    std::vector<glm::uvec3> points;
    for (std::size_t i = 0; i < count; ++i) points.emplace_back(random.below(9), random.below(9), random.below(9));
    std::vector<SurfaceSample> samples = drawSamples(random, 50);
    samples[0].position = query.eye;
    samples[1].position = query.grid.point(points[0].x, points[0].y, points[0].z);
    const UseTable uses = usesOfPoints(query, points, samples);
    ASSERT_EQ(uses.items(), count);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t s = 0; s < samples.size(); ++s) {
        const glm::vec3 place = query.grid.point(points[i].x, points[i].y, points[i].z);
        ASSERT_EQ(uses.at(i, s), useByFormula(query, place, samples[s])) << i << " " << s;
        ASSERT_EQ(useOfPoint(query, place, samples[s]), uses.at(i, s));
      }
  }
}

TEST(GreedyChoice, choosesAsIfAllWereLookedAt) {
  Random random(2);
  for (int round = 0; round < 60; ++round) {
    const std::size_t items = 1 + random.below(70), count = 1 + random.below(150);
    const std::vector<SurfaceSample> samples = drawSamples(random, count);
    UseTable uses(items, count), shown(items, count);
    for (std::size_t i = 0; i < items; ++i)
      for (std::size_t s = 0; s < count; ++s) {
        // Few different values make ties.
        const float use = random.below(3) == 0 ? 0.0F
                          : round % 2 == 0     ? random.unit()
                                               : 0.25F * static_cast<float>(random.below(4));
        uses.set(i, s, use);
        if (random.below(3) != 0) shown.set(i, s, use);
      }
    std::set<std::pair<std::size_t, std::size_t>> asked;
    const auto chosen = chooseGreedily(
        uses, samples,
        [&](std::size_t item, std::size_t sample) {
          EXPECT_TRUE(asked.emplace(item, sample).second) << "twice";
          EXPECT_GT(uses.at(item, sample), 0.0F);
          return shown.at(item, sample) > 0.0F;
        },
        12);
    const auto expected = chooseAmongAll(shown, samples, 12);
    ASSERT_EQ(chosen.size(), expected.size());
    for (std::size_t i = 0; i < chosen.size(); ++i) {
      ASSERT_EQ(chosen[i].item, expected[i].item) << round << ", " << i;
      ASSERT_EQ(chosen[i].gain, expected[i].gain) << round << ", " << i;
    }
  }
}

TEST(GreedyChoice, testsFewLinesOfWhatIsNotChosen) {
  Random random(3);
  constexpr std::size_t kItems = 200, kSamples = 144;
  const std::vector<SurfaceSample> samples = drawSamples(random, kSamples);
  UseTable uses(kItems, kSamples);
  for (std::size_t i = 0; i < kItems; ++i)
    for (std::size_t s = 0; s < kSamples; ++s) uses.set(i, s, random.unit() / static_cast<float>(1 + i));
  std::size_t asked = 0;
  chooseGreedily(
      uses, samples, [&](std::size_t, std::size_t) { return ++asked, true; }, 8);
  EXPECT_LT(asked, 12 * kSamples);
}

}  // namespace
}  // namespace plan
