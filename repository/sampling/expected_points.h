#pragma once
// The points whose images a store should hold, numbered in Morton order, and the faces of them that it lacks.
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "repository/sampling/grid.h"
#include "repository/sampling/sample_tree.h"
#include "repository/sampling/shard.h"

namespace repository {

/// Without a tree this stands for all points of a shard and stores no list; with a tree it lists the shard's sampled
/// points.
class ExpectedPoints {
 public:
  /// `tree` is null where every point of the grid is sampled; the object keeps no reference to it.
  ExpectedPoints(const Grid& grid, const Shard& shard, const SampleTree* tree);
  std::uint64_t size() const { return listed_ ? codes_.size() : range_.size(); }
  /// The point at `place`, below size().
  glm::uvec3 at(std::uint64_t place) const;
  /// The inverse of at(); nothing for a point of the grid that is not expected.
  std::optional<std::uint64_t> placeOf(const glm::uvec3& point) const;

 private:
  Grid grid_;
  PointRange range_;
  bool listed_ = false;
  std::vector<std::uint64_t> codes_;  // codes of the points' first keys, ascending; used only when listed_
};

/// A run of faces that should be in a store and are not.
struct Gap {
  FaceKey first, last;      ///< both are missing, and so are all expected faces between them in Morton order
  std::uint64_t faces = 0;  ///< number of missing faces in the run
  friend bool operator==(const Gap&, const Gap&) = default;
};

/// Receives the keys of a store in ascending order and records the gaps between them.
class GapFinder {
 public:
  /// Only faces of these points are expected; `points` must outlive the finder.
  explicit GapFinder(const ExpectedPoints& points) : points_(points) {}
  explicit GapFinder(ExpectedPoints&&) = delete;
  /// `key` lies in the grid and is larger than all keys added before.
  void addPresentKey(const FaceKey& key);
  /// Call this after the last key: every expected face behind it is missing.
  void finish() { addGapUpTo(6 * points_.size()); }
  const std::vector<Gap>& gaps() const { return gaps_; }
  std::size_t found() const { return gaps_.size(); }

 private:
  FaceKey keyAt(std::uint64_t place) const;
  std::optional<std::uint64_t> placeOf(const FaceKey& key);
  void addGapUpTo(std::uint64_t place);

  const ExpectedPoints& points_;
  std::uint64_t next_ = 0;  // place of the next expected face
  std::optional<glm::uvec3> last_point_;
  std::optional<std::uint64_t> last_place_;
  std::vector<Gap> gaps_;
};

}  // namespace repository
