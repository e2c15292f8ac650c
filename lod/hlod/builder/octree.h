#pragma once
// The cells of the octree (Guthe et al. 2004, section 3): a triangle lies in the cell of its median code, whole. The
// paper cuts triangles at the borders of cells; here neighbours share vertices instead.
#include <cstdint>
#include <optional>
#include <vector>

#include "lod/hlod/builder/ordered_triangles.h"

namespace lod::hlod::builder {

struct Cell {
  std::uint64_t code = 0;   ///< Morton code of the cell's lowest corner
  std::uint32_t depth = 0;  ///< the cell's edge has 2^(bits − depth) lattice steps
  std::uint64_t first = 0;  ///< its triangles: first … first + count − 1
  std::uint64_t count = 0;  ///< above 0
  std::uint32_t parent = 0;
  std::uint32_t first_child = 0;
  std::uint32_t children = 0;
  bool isLeaf() const { return children == 0; }
};

/// Divides cells of more than `max_triangles` (a cell of one lattice step may hold more). Cells are numbered as nodes
/// are (lod/hlod/format.h). Errors: those of reading.
base::Result<std::vector<Cell>> makeOctree(const OrderedTriangles& triangles, std::uint32_t bits,
                                           std::uint32_t max_triangles);

/// The cells as bytes of a stage's state, and back; nullopt where the bytes are none.
void writeCells(base::ByteWriter& out, const std::vector<Cell>& cells);
std::optional<std::vector<Cell>> readCells(base::ByteReader& in);

}  // namespace lod::hlod::builder
