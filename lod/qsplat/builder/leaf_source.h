#pragma once
// The interface from which the tree is built: leaves, tile by tile, of a mesh or of points.
#include <vector>

#include "base/error.h"
#include "lod/qsplat/builder/splat.h"

namespace lod::qsplat::builder {

struct TileLeaves {
  std::vector<Splat> splats;  ///< in an order that depends on the source only; may be empty
  LeafFacets facets;          ///< around them
  std::uint64_t added = 0;    ///< how many splats are not a vertex or point of the source
};

class LeafSource {
 public:
  virtual ~LeafSource() = default;
  virtual std::size_t tiles() const = 0;
  /// The most bytes that leaves() and then a tree over them take.
  virtual std::uint64_t memoryOf(std::size_t tile) const = 0;
  /// Safe from several threads. Errors: those of reading.
  virtual base::Result<TileLeaves> leaves(std::size_t tile) const = 0;
};

}  // namespace lod::qsplat::builder
