#pragma once
// The border edges of a source, in a work file: a scan in many tiles has more of them than memory holds.
#include <compare>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "lod/ingest/spool.h"

namespace lod::ingest {

/// An edge of only one triangle, as it runs there: codes of its ends and of the triangle's third corner, and the
/// colours of its ends (R G B A from the lowest byte; A = 0 where unknown).
struct BorderEdge {
  std::uint64_t from = 0, to = 0, third = 0;
  std::uint32_t from_color = 0, to_color = 0;
  auto operator<=>(const BorderEdge&) const = default;
};

/// A part of the lattice between two planes across an axis, in lattice steps, and as much beside it on either side as
/// decides on what lies in it. By default all of a lattice.
struct BorderSlab {
  int axis = 0;
  int begin = 0;
  int end = 1 << 21;  ///< the first step beyond; no lattice has more than 21 bits an axis
  int beside = 0;

  bool owns(int at) const { return at >= begin && at < end; }
  /// Whether everything between these two steps lies here or beside.
  bool seesAll(int low, int high) const { return low >= begin - beside && high < end + beside; }
  bool touches(int low, int high) const { return high >= begin - beside && low < end + beside; }
};

class BorderEdges {
 public:
  /// Creates the work file. Slabs lie across `axis`; points have `bits` bits an axis. Errors: kNoSpace, kIo.
  static base::Result<BorderEdges> create(const std::string& path, int axis, std::uint32_t bits);

  /// Adds the edges of a bucket. An edge of `shared` belongs to the border unless another bucket adds it, too.
  base::Result<void> add(std::span<const BorderEdge> own, std::span<const BorderEdge> shared);
  /// After the last bucket.
  base::Result<void> flush() { return file_.flush(); }
  /// How many were added.
  std::uint64_t count() const { return count_; }

  /// Slabs that cover space, each with at most `most` edges in it and up to `beside` steps beside it. Nothing where the
  /// edges lie too close together for that.
  std::optional<std::vector<BorderSlab>> slabs(std::uint64_t most, int beside) const;
  /// The edges that touch the slab or what lies beside it, in no certain order.
  base::Result<std::vector<BorderEdge>> read(const BorderSlab& slab) const;
  /// Removes the work file.
  void remove();

 private:
  struct Block {
    std::uint64_t offset = 0;
    std::size_t own = 0, all = 0;
    int low = 0, high = 0;
  };
  struct Range {
    int low = 0, high = 0;
  };
  Range rangeOf(const BorderEdge& edge) const;
  std::uint64_t touching(int low, int high) const;

  SpoolFile file_;
  int axis_ = 0;
  std::uint32_t bin_shift_ = 0;
  std::uint64_t count_ = 0;
  std::vector<Block> blocks_;
  // By bin of the axis: how many edges begin in it, and how many end.
  std::vector<std::uint64_t> begins_, ends_;
};

}  // namespace lod::ingest
