#pragma once
// Where the leaves of a tree come from, tile by tile. Private to lod/build/qsplat.
#include <vector>

#include "base/error.h"
#include "lod/build/qsplat/splat.h"

namespace lod::build::qsplat {

class LeafSource {
 public:
  virtual ~LeafSource() = default;
  virtual std::size_t tiles() const = 0;
  /// Bytes that leaves() takes, at most, and then a tree over them.
  virtual std::uint64_t memoryOf(std::size_t tile) const = 0;
  /// Leaves in an order that only the source decides; may be none. Safe from several threads. Errors: those of reading.
  virtual base::Result<std::vector<Splat>> leaves(std::size_t tile) const = 0;
};

}  // namespace lod::build::qsplat
