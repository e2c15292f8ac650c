#include "client/app/measure.h"

#include <gtest/gtest.h>

#include <glm/gtc/constants.hpp>

namespace client {
namespace {

MeasuredPoint at(const glm::dvec3& position, double accuracy = 0.0) {
  return {position, {}, accuracy, false, 0};
}

/// Survey coordinates are so large that floats would lose the centimetres.
const glm::dvec3 kOrigin{500'000.0, 4'000'000.0, 100.0};

TEST(Measure, aChainHasSegmentsAndATotal) {
  Measurement chain;
  chain.points = {at(kOrigin, 0.002), at(kOrigin + glm::dvec3(3.0, 4.0, 0.0), 0.003)};
  auto values = measuredValues(chain, "m");
  ASSERT_EQ(values.size(), 1U) << "no total of one segment";
  EXPECT_NEAR(values[0].value, 5.0, 1e-9);
  EXPECT_NEAR(values[0].accuracy, 0.005, 1e-12) << "both ends may be off";
  EXPECT_EQ(values[0].text, "5.000 m \u00B1 0.005 m");
  EXPECT_NEAR(values[0].at.x, kOrigin.x + 1.5, 1e-9);

  chain.points.push_back(at(kOrigin + glm::dvec3(3.0, 4.0, 0.001), 0.0));
  values = measuredValues(chain, "m");
  ASSERT_EQ(values.size(), 3U);
  EXPECT_TRUE(values[2].total);
  EXPECT_NEAR(values[2].value, 5.001, 1e-8) << "a millimetre at four million";
  EXPECT_NEAR(values[2].accuracy, 0.008, 1e-12);
}

TEST(Measure, anAngleIsThatAtTheSecondPoint) {
  Measurement angle;
  angle.kind = MeasureKind::kAngle;
  angle.points = {at(kOrigin + glm::dvec3(2.0, 0.0, 0.0)), at(kOrigin)};
  EXPECT_TRUE(measuredValues(angle, "m").empty());
  angle.points.push_back(at(kOrigin + glm::dvec3(0.0, 0.0, 7.0)));
  const auto values = measuredValues(angle, "m");
  ASSERT_EQ(values.size(), 1U);
  EXPECT_NEAR(values[0].value, glm::half_pi<double>(), 1e-12);
  EXPECT_EQ(values[0].at, kOrigin);
  EXPECT_EQ(values[0].text, "90.0000\u00B0");
}

TEST(Measure, theStatedAccuracyOfAnAngleHoldsForAnyPointsWithinTheirs) {
  Measurement angle;
  angle.kind = MeasureKind::kAngle;
  angle.points = {at({2.0, 0.0, 0.0}, 0.1), at({0.0, 0.0, 0.0}, 0.05), at({1.0, 1.5, 0.0}, 0.2)};
  const MeasuredValue stated = measuredValues(angle, "m")[0];
  double worst = 0.0;
  for (int i = 0; i < 512; ++i) {
    Measurement moved = angle;
    for (int p = 0; p < 3; ++p) {
      const double turn = glm::two_pi<double>() * ((i >> (3 * p)) & 7) / 8.0;
      auto& point = moved.points[static_cast<std::size_t>(p)];
      point.position += point.accuracy * glm::dvec3(std::cos(turn), std::sin(turn), 0.0);
    }
    worst = std::max(worst, std::abs(measuredValues(moved, "m")[0].value - stated.value));
  }
  EXPECT_LE(worst, stated.accuracy);
  EXPECT_GT(worst, 0.5 * stated.accuracy) << "and is no wild guess";
}

TEST(Measure, digitsEndWhereTheAccuracyBegins) {
  EXPECT_EQ(formatLength(12.3456, 0.02, false, "m"), "12.35 m \u00B1 0.02 m");
  EXPECT_EQ(formatLength(12.3456, 0.021, false, "m"), "12.35 m \u00B1 0.03 m") << "a bound is rounded up";
  EXPECT_EQ(formatLength(1234.56, 30.0, false, "m"), "1235 m \u00B1 30 m");
  EXPECT_EQ(formatLength(12.3456, 0.2, true, "m"), "about 12.3 m");
  EXPECT_EQ(formatLength(12.3456, 0.0, false, "mm"), "12.3456 mm");
  EXPECT_EQ(formatLength(123456789.0, 1e-6, false, "m"), "123456789 m \u00B1 1 m") << "nine digits at most";
  EXPECT_EQ(formatLength(2.0, 0.1, false, ""), "2.0 units \u00B1 0.1 units");
  EXPECT_EQ(formatLength(2.0, 0.1, false, "unknown"), "2.0 units \u00B1 0.1 units");
  EXPECT_EQ(formatLength(0.0, 0.0, false, "m"), "0.00000 m");
  EXPECT_EQ(formatAngle(glm::pi<double>() / 4.0, glm::radians(0.3), false), "45.0\u00B0 \u00B1 0.3\u00B0");
}

TEST(MeasureTool, theAnswerReplacesThePointThatAsked) {
  MeasureTool tool;
  MeasuredPoint coarse = at({1.0, 0.0, 0.0}, 0.5);
  coarse.approximate = true;
  coarse.pick_id = 7;
  ASSERT_TRUE(tool.add(coarse));
  EXPECT_FALSE(tool.answer(6, {PickAnswer::Kind::kHit, {}, {}, 0.0}));
  EXPECT_TRUE(tool.answer(7, {PickAnswer::Kind::kHit, {1.1, 0.0, 0.0}, {1.0, 0.0, 0.0}, 0.01}));
  const MeasuredPoint& point = tool.all()[0].points[0];
  EXPECT_EQ(point.position, glm::dvec3(1.1, 0.0, 0.0));
  EXPECT_FALSE(point.approximate);
  EXPECT_EQ(point.accuracy, 0.01);
  EXPECT_FALSE(tool.answer(7, {PickAnswer::Kind::kHit, {}, {}, 0.0})) << "only once";
}

TEST(MeasureTool, noAnswerLeavesTheApproximatePoint) {
  for (const auto kind : {PickAnswer::Kind::kNone, PickAnswer::Kind::kUnknown}) {
    MeasureTool tool;
    MeasuredPoint coarse = at({1.0, 0.0, 0.0}, 0.5);
    coarse.approximate = true;
    coarse.pick_id = 7;
    tool.add(coarse);
    tool.answer(7, {kind, {}, {}, 0.0});
    EXPECT_TRUE(tool.all()[0].points[0].approximate);
    EXPECT_EQ(tool.all()[0].points[0].position, coarse.position);
  }
}

TEST(MeasureTool, anAngleEndsWithItsThirdPointAndAChainWhenTold) {
  MeasureTool tool;
  tool.start(MeasureKind::kAngle);
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(tool.add(at({static_cast<double>(i), 0.0, 0.0})));
  ASSERT_EQ(tool.all().size(), 2U);
  EXPECT_EQ(tool.all()[0].points.size(), 3U);
  tool.start(MeasureKind::kDistance);
  EXPECT_EQ(tool.all().size(), 1U) << "the lone point of the second angle measures nothing";
  EXPECT_TRUE(tool.add(at({9.0, 0.0, 0.0})));
  EXPECT_FALSE(tool.add(at({9.0, 0.0, 0.0}))) << "twice the same place";
  EXPECT_TRUE(tool.add(at({9.0, 1.0, 0.0})));
  tool.finish();
  EXPECT_TRUE(tool.add(at({5.0, 1.0, 0.0})));
  EXPECT_EQ(tool.all().size(), 3U);
}

TEST(MeasureTool, pointsAreTakenBackOneByOneToTheFirst) {
  MeasureTool tool;
  for (int i = 0; i < 3; ++i) tool.add(at({static_cast<double>(i), 0.0, 0.0}));
  tool.finish();
  tool.add(at({9.0, 0.0, 0.0}));
  for (std::size_t left : {3U, 2U, 1U, 0U}) {
    tool.removeLast();
    std::size_t count = 0;
    for (const auto& one : tool.all()) count += one.points.size();
    EXPECT_EQ(count, left);
  }
  tool.removeLast();
  EXPECT_TRUE(tool.all().empty());
}

TEST(MeasureTool, theNumberOfPointsIsLimited) {
  MeasureTool tool;
  for (std::size_t i = 0; i < kMaxMeasuredPoints; ++i) ASSERT_TRUE(tool.add(at({static_cast<double>(i), 0.0, 0.0})));
  EXPECT_TRUE(tool.full());
  EXPECT_FALSE(tool.add(at({-1.0, 0.0, 0.0})));
}

}  // namespace
}  // namespace client
