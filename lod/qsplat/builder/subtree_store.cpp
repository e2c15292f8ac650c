#include "lod/qsplat/builder/subtree_store.h"

#include "base/fields.h"

namespace lod::qsplat::builder {
namespace {

struct Record {
  std::uint32_t tile = 0;
  StoredSubtree subtree;
};

// Reads a record whose payload lies at `offset`; false where it is none.
bool readRecord(std::uint64_t offset, base::ByteView payload, Record& record) {
  base::ByteReader in(payload);
  base::readFields(in, std::tie(record.tile, record.subtree.root, record.subtree.added_leaves));
  const std::uint32_t levels = in.u32();
  if (!in.ok() || levels > in.remaining() / 4) return false;
  for (std::uint32_t l = 0; l < levels; ++l) {
    record.subtree.level_nodes.push_back(in.u32());
    record.subtree.nodes += record.subtree.level_nodes.back();
  }
  record.subtree.offset = offset + in.offset();
  if (record.subtree.nodes * sizeof(TreeNode) != in.remaining()) return false;
  if (record.subtree.nodes > 0) record.subtree.root_node = in.read<TreeNode>();
  return true;
}

}  // namespace

base::Result<SubtreeStore> SubtreeStore::open(const std::string& path, bool resume, std::size_t tiles) {
  SubtreeStore store;
  store.tiles_.resize(tiles);
  const auto keep = [&](std::uint64_t offset, base::ByteView payload) {
    Record record;
    if (!readRecord(offset, payload, record) || record.tile >= tiles) return false;
    store.tiles_[record.tile] = std::move(record.subtree);
    return true;
  };
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, keep));
  return store;
}

base::Result<void> SubtreeStore::add(std::uint32_t tile, const Subtree& tree) {
  base::ByteWriter out;
  base::writeFields(out, std::tie(tile, tree.root, tree.added_leaves));
  out.u32(static_cast<std::uint32_t>(tree.level_nodes.size()));
  for (const std::uint32_t nodes : tree.level_nodes) out.u32(nodes);
  out.bytes(
      base::ByteView(reinterpret_cast<const std::uint8_t*>(tree.nodes.data()), tree.nodes.size() * sizeof(TreeNode)));
  LUMIGRID_ASSIGN_OR_RETURN(const auto offset, log_.add(out.view()));
  Record record;
  (void)readRecord(offset, out.view(), record);
  tiles_[tile] = std::move(record.subtree);
  return {};
}

base::Result<std::vector<TreeNode>> SubtreeStore::nodes(std::size_t tile) const {
  const StoredSubtree& subtree = (*this)[tile];
  std::vector<TreeNode> nodes(static_cast<std::size_t>(subtree.nodes));
  LUMIGRID_TRY(log_.readAt(subtree.offset,
                           std::span(reinterpret_cast<std::uint8_t*>(nodes.data()), nodes.size() * sizeof(TreeNode))));
  return nodes;
}

}  // namespace lod::qsplat::builder
