#include "compare/chart.h"

#include <gtest/gtest.h>

namespace {

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

TEST(Chart, drawsAMarkerForEachPointAndNamesEachSeries) {
  const std::string svg = compare::formatChart({"T", "x", "y", false, {{"one", {{0, 1}, {2, 3}}}, {"two", {{1, 2}}}}});
  EXPECT_EQ(count(svg, "r=\"3\""), 3U);
  EXPECT_EQ(count(svg, ">one<"), 1U);
  EXPECT_EQ(count(svg, ">two<"), 1U);
}

TEST(Chart, leavesOutPointsWithoutALogarithm) {
  const std::string svg = compare::formatChart({"T", "x", "y", true, {{"s", {{0, 1}, {-1, 1}, {10, 2}, {100, 3}}}}});
  EXPECT_EQ(count(svg, "r=\"3\""), 2U);
  EXPECT_EQ(count(svg, "nan"), 0U);
  EXPECT_EQ(count(svg, "inf"), 0U);
}

TEST(Chart, escapesNamesAndSurvivesNoPoints) {
  const std::string svg = compare::formatChart({"a < b & c", "x", "y", true, {{"<s>", {}}}});
  EXPECT_NE(svg.find("a &lt; b &amp; c"), std::string::npos);
  EXPECT_EQ(svg.find("<s>"), std::string::npos);
  EXPECT_EQ(count(svg, "nan"), 0U);
}

}  // namespace
