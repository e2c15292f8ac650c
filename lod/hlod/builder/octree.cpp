#include "lod/hlod/builder/octree.h"

#include <array>

#include "base/fields.h"

namespace lod::hlod::builder {
namespace {

auto fieldsOf(auto& cell) {
  return std::tie(cell.code, cell.depth, cell.first, cell.count, cell.parent, cell.first_child, cell.children);
}

}  // namespace

base::Result<std::vector<Cell>> makeOctree(const OrderedTriangles& triangles, std::uint32_t bits,
                                           std::uint32_t max_triangles) {
  std::vector<Cell> cells;
  Cell root;
  root.count = triangles.count();
  cells.push_back(root);
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    const Cell cell = cells[c];
    if (cell.count <= max_triangles || cell.depth == bits) continue;
    const std::uint64_t codes = std::uint64_t{1} << 3 * (bits - cell.depth - 1);
    std::array<std::uint64_t, 9> begin{};
    begin.front() = cell.first;
    begin.back() = cell.first + cell.count;
    for (std::size_t k = 1; k < 8; ++k) {
      LUMIGRID_ASSIGN_OR_RETURN(begin[k], triangles.lowerBound(cell.code + k * codes));
    }
    cells[c].first_child = static_cast<std::uint32_t>(cells.size());
    for (std::size_t k = 0; k < 8; ++k) {
      if (begin[k + 1] == begin[k]) continue;
      Cell child;
      child.code = cell.code + k * codes;
      child.depth = cell.depth + 1;
      child.first = begin[k];
      child.count = begin[k + 1] - begin[k];
      child.parent = c;
      cells.push_back(child);
      ++cells[c].children;
    }
  }
  return cells;
}

void writeCells(base::ByteWriter& out, const std::vector<Cell>& cells) {
  out.u64(cells.size());
  for (const Cell& cell : cells) base::writeFields(out, fieldsOf(cell));
}

std::optional<std::vector<Cell>> readCells(base::ByteReader& in) {
  const std::uint64_t count = in.u64();
  if (count > in.remaining()) return std::nullopt;
  std::vector<Cell> cells(static_cast<std::size_t>(count));
  for (Cell& cell : cells) base::readFields(in, fieldsOf(cell));
  if (!in.ok()) return std::nullopt;
  return cells;
}

}  // namespace lod::hlod::builder
