#pragma once
// Where the leaves of a tree come from, tile by tile. Private to lod/build/qsplat.
#include <vector>

#include "base/error.h"
#include "lod/qsplat/builder/splat.h"

namespace lod::qsplat::builder {

struct TileLeaves {
  std::vector<Splat> splats;  ///< in an order that only the source decides; may be none
  LeafFacets facets;          ///< around them
  std::uint64_t added = 0;    ///< how many of them are no vertex or point of the source
};

class LeafSource {
 public:
  virtual ~LeafSource() = default;
  virtual std::size_t tiles() const = 0;
  /// Bytes that leaves() takes, at most, and then a tree over them.
  virtual std::uint64_t memoryOf(std::size_t tile) const = 0;
  /// Safe from several threads. Errors: those of reading.
  virtual base::Result<TileLeaves> leaves(std::size_t tile) const = 0;
};

}  // namespace lod::qsplat::builder
