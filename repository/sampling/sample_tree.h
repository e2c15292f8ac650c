#pragma once
// The points of the grid that are sampled: the corners of an octree's leaves (Okamoto 2011 names sampling by geometric
// complexity as future work). Keys stay those of the finest grid (docs/formats/repository.md, "Tree of sampling
// points").
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <unordered_set>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/sampling/grid.h"

namespace repository {

/// Cells are cubes of 2^n grid steps. One that reaches beyond the grid's far sides has its corners on those sides.
class SampleTree {
 public:
  struct Cell {
    glm::uvec3 corner{0};    ///< lowest, in grid steps; a multiple of size
    std::uint32_t size = 1;  ///< grid steps along an edge: 1, 2, 4 …
    friend bool operator==(const Cell&, const Cell&) = default;
  };

  /// Open leaves of `size` steps, a power of two, cover the grid, or a single leaf where the grid is smaller.
  SampleTree(const Grid& grid, std::uint32_t size);

  /// The leaf that holds grid cell `cell`, whose indices are 0 … count − 2.
  Cell leafOf(const glm::uvec3& cell) const;
  /// The leaf that holds `place`, clamped to the grid.
  Cell leafAt(const Grid& grid, const glm::vec3& place) const { return leafOf(grid.cellOf(place)); }
  /// The points at a cell's corners: i & 1 is the far side in x, i >> 1 & 1 in y, i >> 2 in z. Some of them coincide
  /// where the grid ends within the cell.
  std::array<glm::uvec3, 8> cornersOf(const Cell& cell) const;
  /// All sampled points in Morton order.
  std::vector<glm::uvec3> points() const;

  /// The leaves that are neither split nor closed yet, in Morton order. Cells of one step cannot be split and are never
  /// among them.
  std::vector<Cell> openLeaves() const;
  /// Divides an open leaf into eight open ones.
  void split(const Cell& leaf);
  /// Keeps an open leaf undivided from now on.
  void close(const Cell& leaf);
  /// Leaves out a point, for instance one inside the model or one that sees nothing.
  void leaveOut(const glm::uvec3& point);
  bool leavesOut(const glm::uvec3& point) const { return left_out_.count(codeOfPoint(point)) != 0; }

  /// How the points that are left out are written; the number is the version. Published ones are read over a network.
  enum class Form : std::uint8_t { kStored = 1, kPublished = 2 };
  base::Bytes encode(Form form = Form::kStored) const;
  /// Reads both forms. Hostile bytes give an error and never take more than 256 times their own memory.
  static base::Result<SampleTree> decode(const Grid& grid, base::ByteView bytes);

 private:
  enum class State : std::uint8_t { kOpen = 0, kClosed = 1, kSplit = 2 };
  struct Node {
    State state = State::kOpen;
    std::uint32_t children = 0;  // the first of eight, side by side
  };
  explicit SampleTree(const Grid& grid);
  bool outside(const glm::uvec3& corner) const;
  /// The number of the leaf that holds the grid cell, whose extent goes to `at`.
  std::uint32_t descend(const glm::uvec3& cell, Cell& at) const;
  Node& find(const Cell& leaf);
  void divide(std::uint32_t node);
  void divideTo(std::uint32_t size, std::uint32_t node, std::uint32_t node_size, const glm::uvec3& corner);
  template <class Visit>
  void visit(std::uint32_t node, const Cell& cell, const Visit& leaf) const;

  glm::uvec3 count_;  // points
  std::uint32_t root_size_ = 1;
  std::vector<Node> nodes_{1};
  std::unordered_set<std::uint64_t> left_out_;
};

/// The points at which a repository's images were taken.
struct SampledPoints {
  Grid grid;
  std::optional<SampleTree> tree;  ///< the sampled ones, where not all points are

  const SampleTree* treeOrNull() const { return tree ? &*tree : nullptr; }
  std::uint64_t count() const { return tree ? tree->points().size() : grid.pointCount(); }
};

}  // namespace repository
