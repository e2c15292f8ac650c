#include "lod/pmr/builder/class_store.h"

#include "base/bytes.h"

namespace lod::pmr::builder {

base::Result<ClassStore> ClassStore::open(const std::string& path, bool resume, const std::vector<OctreeCell>& cells,
                                          const std::vector<CellBlock>& blocks) {
  ClassStore store;
  store.cells_ = &cells;
  store.blocks_ = &blocks;
  store.offsets_.resize(blocks.size());
  store.block_of_.resize(cells.size());
  for (std::uint32_t b = 0; b < blocks.size(); ++b)
    for (std::uint32_t c = blocks[b].first; c < blocks[b].end; ++c) store.block_of_[c] = b;
  const auto keep = [&](std::uint64_t offset, base::ByteView payload) {
    base::ByteReader in(payload);
    const std::uint32_t block = in.u32();
    if (!in.ok() || block >= blocks.size()) return false;
    std::uint64_t points = 0;
    for (std::uint32_t c = blocks[block].first; c < blocks[block].end; ++c) points += cells[c].count;
    if (in.remaining() != points * sizeof(PointClass)) return false;
    if (store.has(block)) return true;
    store.offsets_[block] = offset + sizeof(block);
    while (in.remaining() > 0)
      if (in.read<PointClass>().coarsest >= kLevels) return false;
    return true;
  };
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, keep));
  return store;
}

base::Result<void> ClassStore::add(std::uint32_t block, std::span<const PointClass> classes) {
  base::ByteWriter out;
  out.u32(block);
  out.bytes(base::ByteView(reinterpret_cast<const std::uint8_t*>(classes.data()), classes.size_bytes()));
  LUMIGRID_ASSIGN_OR_RETURN(const auto offset, log_.add(out.view()));
  offsets_[block] = offset + sizeof(block);
  return {};
}

base::Result<std::vector<PointClass>> ClassStore::read(std::uint32_t cell) const {
  const std::uint32_t block = block_of_[cell];
  const std::uint64_t before = (*cells_)[cell].first - (*cells_)[(*blocks_)[block].first].first;
  std::vector<PointClass> classes((*cells_)[cell].count);
  LUMIGRID_TRY(
      log_.readAt(*offsets_[block] + before * sizeof(PointClass),
                  std::span(reinterpret_cast<std::uint8_t*>(classes.data()), classes.size() * sizeof(PointClass))));
  return classes;
}

}  // namespace lod::pmr::builder
