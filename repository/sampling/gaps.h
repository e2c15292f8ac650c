#pragma once
// The faces that a store lacks, from the keys that it has.
#include <cstdint>
#include <optional>
#include <vector>

#include "repository/sampling/expected_points.h"
#include "repository/sampling/grid.h"

namespace repository {

/// Faces that should be in a store and are not.
struct Gap {
  FaceKey first, last;      ///< both missing, and all expected faces between them in Morton order
  std::uint64_t faces = 0;  ///< so many
  friend bool operator==(const Gap&, const Gap&) = default;
};

/// Takes keys in ascending order and keeps what lies between them.
class GapFinder {
 public:
  /// Only faces of these points are expected; they outlive the finder.
  explicit GapFinder(const ExpectedPoints& points) : points_(points) {}
  explicit GapFinder(ExpectedPoints&&) = delete;
  /// A key of the grid, larger than those before it.
  void take(const FaceKey& key);
  /// All keys were taken: what is left is missing.
  void finish() { missUpTo(6 * points_.size()); }
  const std::vector<Gap>& gaps() const { return gaps_; }
  std::size_t found() const { return gaps_.size(); }

 private:
  FaceKey keyAt(std::uint64_t place) const;
  std::optional<std::uint64_t> placeOf(const FaceKey& key);
  void missUpTo(std::uint64_t place);

  const ExpectedPoints& points_;
  std::uint64_t next_ = 0;  // the expected face that should come next
  std::optional<glm::uvec3> last_point_;
  std::optional<std::uint64_t> last_place_;
  std::vector<Gap> gaps_;
};

}  // namespace repository
