#include "lod/pmr/builder/leaf_store.h"

#include "base/fields.h"
#include "base/file.h"
#include "lod/pmr/chunk_order.h"
#include "lod/pmr/leaf_picture.h"

namespace lod::pmr::builder {
namespace {

constexpr std::size_t kWriteBytes = 1U << 20;

auto fieldsOf(auto& leaf) {
  return std::tie(leaf.leaf.code, leaf.leaf.depth, leaf.leaf.box, leaf.leaf.levels, leaf.unused);
}

std::uint64_t chunkBytes(const Leaf& leaf) {
  std::uint64_t bytes = 0;
  for (const LevelRow& row : leaf.levels) bytes += row.point_bytes + row.triangle_bytes;
  return bytes;
}

/// Where a chunk of a leaf lies in the store.
std::uint64_t storedAt(const LeafStore::StoredLeaf& leaf, std::uint32_t chunk) {
  std::uint64_t offset = leaf.offset;
  for (std::uint32_t c = 0; c < chunk; ++c) offset += placeOf(leaf.leaf, c).bytes;
  return offset;
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
  const ChunkOrder order(header.leaves);
  base::Bytes buffer;
  for (std::uint64_t place = 0; place < order.chunks(); ++place) {
    const ChunkId id = order.at(place);
    const std::size_t before = buffer.size();
    buffer.resize(before + placeOf(table[id.leaf], id.chunk).bytes);
    LUMIGRID_TRY(store.readAt(storedAt(leaves[id.leaf], id.chunk), std::span(buffer).subspan(before)));
    if (buffer.size() < kWriteBytes && place + 1 < order.chunks()) continue;
    LUMIGRID_TRY(file.write(buffer));
    buffer.clear();
    if (progress && !progress(static_cast<double>(place + 1) / static_cast<double>(order.chunks())))
      return base::Error{base::ErrorCode::kCancelled, "writing the points and umbrellas was cancelled"};
  }
  LUMIGRID_TRY(file.commit());
  return header;
}

}  // namespace lod::pmr::builder
