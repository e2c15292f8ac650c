#pragma once
// A font for lettering in generated textures. Each glyph has 5 x 7 cells, and glyphs stand 6 cells apart.
#include <glm/glm.hpp>
#include <string_view>

namespace mesh::generate {

inline constexpr int kGlyphColumns = 5;
inline constexpr int kGlyphRows = 7;
inline constexpr int kGlyphAdvance = 6;  // cells from one glyph to the next

/// Whether a cell of the character is ink. Row 0 is the top row. There are capital letters, digits and ". - & /"; all
/// other characters are blank.
bool isInk(char character, int column, int row);
/// The width of a line of text, in cells.
double textWidth(std::string_view text);
/// The share of a box that is ink. Its corners are in cells, to the right of and above the text's lower left corner.
double inkIn(std::string_view text, const glm::dvec2& low, const glm::dvec2& high);

}  // namespace mesh::generate
