#include "lod/pmr/builder/leaf_store.h"

#include "base/fields.h"
#include "base/file.h"

namespace lod::pmr::builder {
namespace {

auto fieldsOf(auto& leaf) {
  return std::tie(leaf.leaf.code, leaf.leaf.depth, leaf.leaf.box, leaf.leaf.levels, leaf.unused);
}

std::uint64_t chunkBytes(const Leaf& leaf) {
  std::uint64_t bytes = 0;
  for (const LevelRow& row : leaf.levels) bytes += row.point_bytes + row.triangle_bytes;
  return bytes;
}

std::uint64_t baseBytes(const Leaf& leaf) {
  return leaf.levels[kCoarsest].point_bytes + leaf.levels[kCoarsest].triangle_bytes;
}

}  // namespace

base::Result<LeafStore> LeafStore::open(const std::string& path, bool resume, const std::vector<CellBlock>& blocks) {
  LeafStore store;
  store.leaves_.resize(blocks.size());
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, [&](std::uint64_t offset, auto payload) {
                              return store.keep(offset, payload, blocks);
                            }));
  return store;
}

base::Result<void> LeafStore::add(std::uint32_t block, std::span<const BuiltLeaf> leaves) {
  base::ByteWriter out;
  out.u32(block);
  for (const BuiltLeaf& leaf : leaves) {
    base::writeFields(out, fieldsOf(leaf));
    out.bytes(leaf.chunks);
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto payload, log_.add(out.view()));
  std::uint64_t offset = payload + sizeof(block);
  for (const BuiltLeaf& leaf : leaves) {
    base::ByteWriter fields;
    base::writeFields(fields, fieldsOf(leaf));
    offset += fields.view().size();
    leaves_[block].push_back({leaf.leaf, leaf.unused, offset});
    offset += leaf.chunks.size();
  }
  return {};
}

bool LeafStore::keep(std::uint64_t offset, base::ByteView payload, const std::vector<CellBlock>& blocks) {
  base::ByteReader in(payload);
  const std::uint32_t block = in.u32();
  if (!in.ok() || block >= blocks.size()) return false;
  std::vector<StoredLeaf> leaves;
  while (in.remaining() > 0) {
    StoredLeaf leaf;
    base::readFields(in, fieldsOf(leaf));
    leaf.offset = offset + in.offset();
    if (!in.ok() || chunkBytes(leaf.leaf) > in.remaining()) return false;
    in.bytes(static_cast<std::size_t>(chunkBytes(leaf.leaf)));
    leaves.push_back(leaf);
  }
  if (leaves.size() != blocks[block].end - blocks[block].first) return false;
  leaves_[block] = std::move(leaves);
  return true;
}

std::vector<LeafStore::StoredLeaf> LeafStore::leaves() const {
  std::vector<StoredLeaf> all;
  for (const auto& block : leaves_) all.insert(all.end(), block.begin(), block.end());
  return all;
}

base::Result<Header> writeFile(const LeafStore& store, const std::vector<LeafStore::StoredLeaf>& leaves, Header header,
                               const std::string& path, const std::function<bool(double)>& progress) {
  std::vector<Leaf> table;
  base::Aabb box;
  for (const auto& one : leaves) {
    table.push_back(one.leaf);
    box.add(one.leaf.box);
    for (const LevelRow& row : one.leaf.levels) header.points += row.points;
  }
  header.leaves = static_cast<std::uint32_t>(table.size());
  header.bounds = {box.center(), 0.5F * box.diagonal() * 1.000001F};
  const base::Bytes table_bytes = tableBytes(table, header.lattice);
  header.table_bytes = static_cast<std::uint32_t>(table_bytes.size());
  placeChunks(header, table);

  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
  LUMIGRID_TRY(file.write(headerBytes(header)));
  LUMIGRID_TRY(file.write(table_bytes));
  base::Bytes buffer;
  std::size_t done = 0;
  const auto copy = [&](std::uint64_t offset, std::uint64_t bytes) -> base::Result<void> {
    buffer.resize(static_cast<std::size_t>(bytes));
    LUMIGRID_TRY(store.readAt(offset, buffer));
    LUMIGRID_TRY(file.write(buffer));
    if (progress && !progress(static_cast<double>(++done) / static_cast<double>(2 * leaves.size())))
      return base::Error{base::ErrorCode::kCancelled, "writing the points and umbrellas was cancelled"};
    return {};
  };
  for (const auto& one : leaves) LUMIGRID_TRY(copy(one.offset, baseBytes(one.leaf)));
  for (const auto& one : leaves)
    LUMIGRID_TRY(copy(one.offset + baseBytes(one.leaf), chunkBytes(one.leaf) - baseBytes(one.leaf)));
  LUMIGRID_TRY(file.commit());
  return header;
}

}  // namespace lod::pmr::builder
