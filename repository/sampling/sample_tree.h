#pragma once
// Which points of the grid are sampled: the corners of an octree's leaves (DESIGN section 5, adaptive grid; Okamoto
// 2011, future work: sampling by geometric complexity). Keys stay those of the finest grid. docs/formats/repository.md
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

/// Cells are cubes of 2^n grid steps that may reach beyond the grid's far sides; their corners there lie on the sides.
class SampleTree {
 public:
  struct Cell {
    glm::uvec3 corner{0};    ///< lowest, in grid steps; a multiple of size
    std::uint32_t size = 1;  ///< grid steps along an edge: 1, 2, 4 …
    friend bool operator==(const Cell&, const Cell&) = default;
  };

  /// Open leaves of `size` steps, a power of two, cover the grid (or one leaf, where it is smaller).
  SampleTree(const Grid& grid, std::uint32_t size);

  /// The leaf that holds grid cell `cell`, each index 0 … count − 2.
  Cell leafOf(const glm::uvec3& cell) const;
  /// The leaf that holds a place, clamped to the grid.
  Cell leafAt(const Grid& grid, const glm::vec3& place) const { return leafOf(grid.cellOf(place)); }
  /// The points at a cell's corners: i & 1 is the far side in x, i >> 1 & 1 in y, i >> 2 in z. Some coincide where the
  /// grid ends within the cell.
  std::array<glm::uvec3, 8> cornersOf(const Cell& cell) const;
  /// Whether images are stored there: a corner of a leaf, and not left out.
  bool hasPoint(const glm::uvec3& point) const;
  /// All such points, in Morton order.
  std::vector<glm::uvec3> points() const;
  std::uint64_t leafCount() const;

  /// Leaves nobody has judged, in Morton order. Cells of one step are never among them: they cannot be split.
  std::vector<Cell> openLeaves() const;
  /// An open leaf becomes eight open ones.
  void split(const Cell& leaf);
  /// An open leaf stays.
  void close(const Cell& leaf);
  /// No images at this point: the model hides it, or nothing is seen from there.
  void leaveOut(const glm::uvec3& point);
  bool leavesOut(const glm::uvec3& point) const {
    return left_out_.count(FaceKey{point.x, point.y, point.z, 0}.code()) != 0;
  }

  base::Bytes encode() const;
  /// Hostile bytes are an error; never more memory than 256 times theirs.
  static base::Result<SampleTree> decode(const Grid& grid, base::ByteView bytes);

 private:
  enum class State : std::uint8_t { kOpen = 0, kClosed = 1, kSplit = 2 };
  struct Node {
    State state = State::kOpen;
    std::uint32_t children = 0;  // the first of eight, side by side
  };
  explicit SampleTree(const Grid& grid);
  bool outside(const glm::uvec3& corner) const;
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
  std::optional<SampleTree> tree;  ///< which of them are sampled, where not all are

  const SampleTree* treeOrNull() const { return tree ? &*tree : nullptr; }
  std::uint64_t count() const { return tree ? tree->points().size() : grid.pointCount(); }
};

}  // namespace repository
