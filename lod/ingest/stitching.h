#pragma once
// Closes the seams of a source at import: scans come in tiles whose borders were rounded apart, and each side would be
// simplified by itself, so that gaps open as wide as the tolerance. Border vertices of two sides that nearly touch
// become one, a vertex that lies on another border's edge splits it, and the smallest holes are closed.
// docs/decisions/stitching.md says how seams are told from real slits and thin sheets.
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "lod/ingest/border_edges.h"

namespace lod::ingest {

/// How border vertices are stitched.
struct StitchOptions {
  bool on = true;
  double length = 0.0;  ///< source units: so far apart two vertices may be at most; 0: found from the borders
};
/// Parses "auto", "off" or a length. Error: kInvalidInput.
base::Result<StitchOptions> parseStitch(const std::string& text);
/// The text from which the same options are parsed.
std::string describeStitch(const StitchOptions& options);

/// The changes by count. Lengths are in lattice steps.
struct StitchCounts {
  std::uint64_t source_edges = 0;       ///< border edges before
  std::uint64_t stitched_vertices = 0;  ///< moved onto another
  std::uint64_t split_edges = 0;        ///< border edges cut where a vertex lies on them
  std::uint64_t closed_holes = 0;
  std::uint64_t slabs = 1;        ///< parts of space in which the border was stitched, one after the other
  std::uint64_t too_many = 0;     ///< 1: no part was small enough for the memory, so that nothing was stitched
  double reach = 0.0;             ///< so many times the shorter edge beside it a stitched gap may be wide
  double largest_movement = 0.0;  ///< of a stitched vertex, and of an edge that was split
};

/// All changes to the source's triangles, on the lattice.
class Stitches {
 public:
  struct Move {
    std::uint64_t from = 0, to = 0;
    auto operator<=>(const Move&) const = default;
  };
  /// The border edge from … to gets `vertices`, in the order in which they lie along it.
  struct Split {
    std::uint64_t from = 0, to = 0;
    std::vector<std::uint64_t> vertices;
  };

  Stitches() = default;
  /// `moves` and `splits` are ascending; the ends of splits are where the moves brought them.
  Stitches(std::vector<Move> moves, std::vector<Split> splits, std::vector<std::array<std::uint64_t, 3>> fills,
           const StitchCounts& counts);

  bool empty() const { return moves_.empty() && splits_.empty() && fills_.empty(); }
  bool hasSplits() const { return !splits_.empty(); }
  const StitchCounts& counts() const { return counts_; }
  /// Where the vertex at this lattice point goes.
  std::uint64_t moved(std::uint64_t code) const;
  /// The vertices that split the edge, whose ends have been moved; empty for most.
  std::span<const std::uint64_t> splitting(std::uint64_t from, std::uint64_t to) const;
  /// The triangles that close holes.
  std::span<const std::array<std::uint64_t, 3>> fills() const { return fills_; }

 private:
  static constexpr std::uint32_t kFilterBits = 20;  // 128 KiB, which stays in a core's cache
  static std::size_t slot(std::uint64_t code) {
    return static_cast<std::size_t>((code * 0x9E3779B97F4A7C15ULL) >> (64 - kFilterBits));
  }
  std::vector<Move> moves_;
  std::vector<Split> splits_;
  std::vector<std::array<std::uint64_t, 3>> fills_;
  StitchCounts counts_;
  // A bit per hash of a code that moves, or that a split edge starts from: one look tells for most.
  std::vector<bool> moves_filter_, splits_filter_;
};

/// The source around its border, in lattice steps.
struct StitchScale {
  double length = 0.0;     ///< StitchOptions::length
  double mean_edge = 0.0;  ///< of all triangles
  double diagonal = 0.0;   ///< of the box
};
/// Memory that findStitches takes for each border edge of a slab.
inline constexpr std::uint64_t kStitchBytesPerEdge = 180;
/// Finds the changes for a source with this border, with at most `most` edges in memory at a time. They do not depend
/// on the order of the edges or on the number of threads; where the border takes several slabs, edges that reach
/// across one and what lies beside it are not split. Errors: those of reading the work file.
base::Result<Stitches> findStitches(const BorderEdges& border, const StitchScale& scale, std::uint64_t most,
                                    unsigned threads);

}  // namespace lod::ingest
