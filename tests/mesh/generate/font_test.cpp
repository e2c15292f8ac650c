// The font's letters differ, and the share of ink in a box is that of the cells beneath it.
#include "mesh/generate/font.h"

#include <gtest/gtest.h>

#include <set>
#include <string>

namespace {

using namespace mesh::generate;

std::string drawn(char c) {
  std::string cells;
  for (int row = 0; row < kGlyphRows; ++row)
    for (int column = 0; column < kGlyphColumns; ++column) cells += isInk(c, column, row) ? '#' : '.';
  return cells;
}

TEST(Font, everyCharacterLooksDifferent) {
  std::set<std::string> seen;
  const std::string characters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-&/ ";
  for (const char c : characters) seen.insert(drawn(c));
  EXPECT_EQ(seen.size(), characters.size());
}

TEST(Font, lettersAreDrawnFromTheTopRowOn) {
  EXPECT_EQ(drawn('L'),
            "#...."
            "#...."
            "#...."
            "#...."
            "#...."
            "#...."
            "#####");
  EXPECT_EQ(drawn('7'),
            "#####"
            "....#"
            "...#."
            "..#.."
            ".#..."
            ".#..."
            ".#...");
}

TEST(Font, inkOfACellIsAllOrNothing) {
  const std::string text = "AB7";
  for (int i = 0; i < static_cast<int>(text.size()); ++i)
    for (int row = 0; row < kGlyphRows; ++row)
      for (int column = 0; column < kGlyphAdvance; ++column) {
        const glm::dvec2 low(kGlyphAdvance * i + column, kGlyphRows - 1 - row);
        EXPECT_EQ(inkIn(text, low, low + 1.0), isInk(text[static_cast<std::size_t>(i)], column, row) ? 1.0 : 0.0);
      }
}

TEST(Font, inkOfABoxIsTheMeanOfItsCells) {
  // The lowest row of L is full, the others have one cell of five.
  EXPECT_DOUBLE_EQ(inkIn("L", {0.0, 0.0}, {5.0, 7.0}), 11.0 / 35.0);
  EXPECT_DOUBLE_EQ(inkIn("L", {0.5, 0.5}, {1.5, 1.5}), 0.5 * 1.0 + 0.5 * 0.5);
  EXPECT_DOUBLE_EQ(inkIn("L", {-1.0, -1.0}, {1.0, 1.0}), 0.25);
  EXPECT_EQ(inkIn("L", {6.0, 0.0}, {7.0, 1.0}), 0.0);
  EXPECT_EQ(inkIn("", {0.0, 0.0}, {1.0, 1.0}), 0.0);
}

TEST(Font, widthEndsWithTheLastLetter) {
  EXPECT_EQ(textWidth("A"), 5.0);
  EXPECT_EQ(textWidth("ABC"), 17.0);
  EXPECT_EQ(textWidth(""), 0.0);
}

}  // namespace
