#include "compare/chart.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

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

TEST(Chart, noTwoOfNineSeriesLookAlike) {
  compare::Chart chart{"T", "x", "y", false, {}};
  for (int i = 0; i < 9; ++i) chart.series.push_back({"series " + std::to_string(i), {{i, 1}, {i + 1, 2}}});
  const std::string svg = compare::formatChart(chart);
  std::set<std::string> looks;
  for (std::size_t at = svg.find("r=\"5\""); at != std::string::npos; at = svg.find("r=\"5\"", at + 1))
    looks.insert(svg.substr(at, svg.find("/>", at) - at));
  EXPECT_EQ(looks.size(), 9U);
  EXPECT_EQ(count(svg, "stroke-dasharray=\"6 3\""), 2U);
}

TEST(Chart, escapesNamesAndSurvivesNoPoints) {
  const std::string svg = compare::formatChart({"a < b & c", "x", "y", true, {{"<s>", {}}}});
  EXPECT_NE(svg.find("a &lt; b &amp; c"), std::string::npos);
  EXPECT_EQ(svg.find("<s>"), std::string::npos);
  EXPECT_EQ(count(svg, "nan"), 0U);
}

}  // namespace
