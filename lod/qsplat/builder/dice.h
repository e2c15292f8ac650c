#pragma once
// Large triangles in pieces, so that no leaf is much larger than those around it (Rusinkiewicz and Levoy 2000, section
// 3.4). Private to lod/build/qsplat.
//
// A triangle is cut at the middle of its longest edge until no edge is longer than a limit (Rivara 1984). An edge ends
// up in pieces that its own length alone decides, so that two triangles cut alike with the same limit share the points
// between them.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <vector>

#include "lod/ingest/code_map.h"

namespace lod::qsplat::builder {

/// The triangles of a tile. Points are known by number: the given ones, then the middles.
class Dicer {
 public:
  struct Middle {
    std::uint32_t a = 0, b = 0;  ///< the ends of its edge, lesser numbers than its own
    glm::dvec3 position{0.0};    ///< exact
  };
  struct Piece {
    std::array<std::uint32_t, 3> corners{};
    std::uint32_t triangle = 0;
  };

  /// `points` must outlive it; fewer than 2^31 with the middles.
  Dicer(std::span<const glm::ivec3> points, double longest_edge);
  /// One for which isCut().
  void cut(const std::array<std::uint32_t, 3>& corners, std::uint32_t triangle);

  const std::vector<Middle>& middles() const { return middles_; }
  /// Wound as their triangles, which come one after the other.
  const std::vector<Piece>& pieces() const { return pieces_; }
  glm::dvec3 position(std::uint32_t point) const {
    return point < points_.size() ? glm::dvec3(points_[point]) : middles_[point - points_.size()].position;
  }

 private:
  std::uint32_t middleOf(std::uint32_t a, std::uint32_t b);

  std::span<const glm::ivec3> points_;
  double longest_squared_;
  ingest::CodeMap by_edge_{64};
  std::vector<Middle> middles_;
  std::vector<Piece> pieces_;
};

/// How often triangles are cut: `points` are 3 for each. A cut makes one point, or half of one that two triangles
/// share. Nothing when it is more often than `most`.
std::optional<std::uint64_t> countCuts(std::span<const glm::ivec3> points, double longest_edge, std::uint64_t most);

/// Whether an edge is longer.
bool isCut(const std::array<glm::ivec3, 3>& triangle, double longest_edge);

}  // namespace lod::qsplat::builder
