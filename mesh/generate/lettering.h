#pragma once
// Signs painted on a surface, each on a board of even light colour. All lie in the plane of x and y, seen from above.
#include <vector>

#include "mesh/generate/textured_surface.h"

namespace mesh::generate {

class Lettering {
 public:
  /// Adds a line of text that begins at `corner`. Its board reaches two cells of the font beyond it.
  void add(const std::string& text, const glm::dvec3& corner, double height, const glm::dvec2& right = {1.0, 0.0});
  /// Adds a board without text, under all the signs.
  void addBoard(const glm::dvec2& low, const glm::dvec2& high, double level = 0.0);
  /// Must be called after the last add(): sorts the signs into cells of the box from 0 to `size`.
  void finish(const glm::dvec2& size);

  const std::vector<Sign>& signs() const { return signs_; }
  /// Paints boards and letters over a colour.
  glm::dvec3 paint(const glm::dvec3& color, const glm::dvec2& p, double texel) const;
  /// The board nearest to p, and how near: 1 on the board, 0 where it is `reach` or more away.
  struct Nearness {
    double share = 0.0;
    double level = 0.0;  ///< the board's z
  };
  Nearness nearness(const glm::dvec2& p, double reach) const;

 private:
  struct Board {
    glm::dvec2 corner, right;
    glm::dvec2 size;  // along right and up
    double level;
    int sign;     // of signs_; −1: none
    double cell;  // metres
    glm::dvec2 up() const { return {-right.y, right.x}; }
    glm::dvec2 local(const glm::dvec2& p) const { return {glm::dot(p - corner, right), glm::dot(p - corner, up())}; }
  };
  static constexpr int kCells = 64;  // along each side; a choice
  void enter(std::uint16_t board);

  std::vector<Sign> signs_;
  std::vector<Board> boards_;
  glm::dvec2 cell_size_{1.0};
  std::vector<std::vector<std::uint16_t>> boards_of_cell_;
};

/// Letters and digits that the seed determines.
std::string randomText(std::uint32_t seed, std::size_t length);

}  // namespace mesh::generate
