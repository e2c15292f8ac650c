#pragma once
// The charts that hang together in a picture over all leaves, and which of them each unit of its JPEG shows. Private to
// lod/texture.
#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "lod/texture/charts.h"

namespace lod::texture {

class UnitCharts {
 public:
  static constexpr std::uint32_t kNone = 0xFFFFFFFF, kSeveral = 0xFFFFFFFE;

  /// `picture` and `unit` are in texels.
  UnitCharts(const glm::ivec2& picture, const glm::ivec2& unit);
  /// Notes the charts of a leaf. Returns the number of the first; the others follow. Safe from several threads.
  std::uint32_t add(std::span<const Chart> charts);
  /// Joins charts of different leaves that share an edge. Called once, after all were added; what follows may be called
  /// from several threads, and does not depend on the order of additions.
  void join();
  /// Names the joined charts that a chart belongs to.
  std::uint32_t joined(std::uint32_t chart) const { return parents_[chart]; }
  /// The joined charts that reach into a unit, kNone, or kSeveral. 0 <= x < size().x, y likewise.
  std::uint32_t at(int x, int y) const { return cells_[index({x, y})]; }
  /// In units, with those that the picture does not fill.
  const glm::ivec2& size() const { return size_; }

 private:
  struct Edge {
    std::array<int, 4> ends{};  // steps, in the first repetition of the picture, the lesser first
    std::uint32_t chart = 0;
  };
  std::size_t index(const glm::ivec2& at) const {
    return static_cast<std::size_t>(at.y) * static_cast<std::size_t>(size_.x) + static_cast<std::size_t>(at.x);
  }
  void addEdges(const Chart& chart, std::uint32_t number);
  void addCells(const Chart& chart, std::uint32_t number);
  void addCell(const glm::ivec2& cell, const glm::ivec2& end, std::uint32_t number);

  glm::ivec2 picture_, unit_, size_;
  std::mutex mutex_;
  std::vector<std::uint32_t> cells_;                         // the first chart that came to the unit
  std::vector<std::pair<std::size_t, std::uint32_t>> also_;  // units to which others came
  std::vector<Edge> edges_;                                  // of one triangle only in their leaf
  std::vector<std::uint32_t> parents_;
};

}  // namespace lod::texture
