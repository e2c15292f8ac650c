#include "lod/hlod/builder/node_store.h"

#include <algorithm>

#include "base/fields.h"
#include "base/file.h"

namespace lod::hlod::builder {
namespace {

constexpr std::size_t kWriteBytes = 1U << 20;

auto fieldsOf(auto& row) {
  return std::tie(row.box, row.cone, row.error, row.shape_error, row.caster_error, row.step_bits, row.triangles,
                  row.points, row.edges, row.caster_triangles, row.picture.bytes, row.caster.bytes);
}

}  // namespace

base::Result<NodeStore> NodeStore::open(const std::string& path, bool resume, std::size_t cells) {
  NodeStore store;
  store.stored_.resize(cells);
  LUMIGRID_ASSIGN_OR_RETURN(store.log_, ingest::RecordLog::open(path, resume, [&](std::uint64_t offset, auto payload) {
                              return store.keep(offset, payload);
                            }));
  return store;
}

base::Result<void> NodeStore::add(std::uint32_t cell, const BuiltNode& node) {
  const bool is_leaf = node.mesh.triangles() == 0 && node.mesh.points.empty();
  const base::Bytes mesh = is_leaf ? base::Bytes() : meshBytes(node.mesh);
  Stored stored;
  stored.row = node.row;
  stored.mesh_triangles = static_cast<std::uint32_t>(node.mesh.triangles());
  stored.mesh_vertices = node.vertices;
  stored.mesh_points = static_cast<std::uint32_t>(node.mesh.points.size());
  stored.mesh_bytes = static_cast<std::uint32_t>(mesh.size());
  base::ByteWriter out;
  out.u32(cell);
  base::writeFields(out, fieldsOf(stored.row));
  out.u32(stored.mesh_triangles);
  out.u32(stored.mesh_vertices);
  out.u32(stored.mesh_points);
  out.u32(stored.mesh_bytes);
  const std::size_t front = out.view().size();
  for (const base::Bytes* part : {&node.picture, &node.caster, &mesh}) out.bytes(*part);
  LUMIGRID_ASSIGN_OR_RETURN(const auto payload, log_.add(out.view()));
  stored.offset = payload + front;
  stored_[cell] = stored;
  return {};
}

bool NodeStore::keep(std::uint64_t offset, base::ByteView payload) {
  base::ByteReader in(payload);
  const std::uint32_t cell = in.u32();
  Stored stored;
  base::readFields(in, fieldsOf(stored.row));
  stored.mesh_triangles = in.u32();
  stored.mesh_vertices = in.u32();
  stored.mesh_points = in.u32();
  stored.mesh_bytes = in.u32();
  stored.offset = offset + in.offset();
  const std::uint64_t bytes = std::uint64_t{stored.row.picture.bytes} + stored.row.caster.bytes + stored.mesh_bytes;
  if (!in.ok() || cell >= stored_.size() || in.remaining() != bytes) return false;
  stored_[cell] = stored;
  return true;
}

base::Result<base::Bytes> NodeStore::read(std::uint64_t offset, std::uint64_t bytes) const {
  base::Bytes out(static_cast<std::size_t>(bytes));
  LUMIGRID_TRY(log_.readAt(offset, out));
  return out;
}

base::Result<NodeMesh> NodeStore::readMesh(std::uint32_t cell) const {
  const Stored& stored = *stored_[cell];
  LUMIGRID_ASSIGN_OR_RETURN(
      const auto bytes, read(stored.offset + stored.row.picture.bytes + stored.row.caster.bytes, stored.mesh_bytes));
  return builder::readMesh(bytes);
}

base::Result<base::Bytes> NodeStore::readBlock(std::uint32_t cell, bool of_caster) const {
  const Stored& stored = *stored_[cell];
  return of_caster ? read(stored.offset + stored.row.picture.bytes, stored.row.caster.bytes)
                   : read(stored.offset, stored.row.picture.bytes);
}

std::vector<Node> linkedRows(const NodeStore& store, const std::vector<Cell>& cells) {
  std::vector<Node> rows;
  rows.reserve(cells.size());
  for (std::uint32_t c = 0; c < cells.size(); ++c) {
    Node row = store.row(c);
    row.first_child = cells[c].first_child;
    row.children = static_cast<std::uint8_t>(cells[c].children);
    rows.push_back(row);
  }
  // Children have larger numbers than their parents.
  std::vector<std::uint8_t> has_cone(cells.size(), 0);
  for (std::size_t c = cells.size(); c-- > 1;) {
    const Node& child = rows[c];
    Node& parent = rows[cells[c].parent];
    parent.cone = has_cone[cells[c].parent] != 0 ? mergedCone(parent.cone, child.cone) : child.cone;
    has_cone[cells[c].parent] = 1;
    parent.box.add(child.box);
    parent.error = std::max(parent.error, child.error);
    parent.shape_error = std::max(parent.shape_error, child.shape_error);
    parent.caster_error = std::max(parent.caster_error, child.caster_error);
  }
  return rows;
}

base::Result<Header> writeFile(const NodeStore& store, std::vector<Node> rows, Header header, const std::string& path,
                               const std::function<bool(double)>& progress) {
  const base::Bytes table = tableBytes(rows, header);
  placeBlocks(header, rows);
  // A file that no reader takes must not replace one that they do.
  if (const auto readable = readTable(header, table); !readable)
    return base::within("the builder's own file", readable.error());

  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
  LUMIGRID_TRY(file.write(headerBytes(header)));
  LUMIGRID_TRY(file.write(table));
  base::Bytes buffer;
  for (const bool of_caster : {false, true}) {
    for (std::uint32_t n = 0; n < rows.size(); ++n) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto block, store.readBlock(n, of_caster));
      buffer.insert(buffer.end(), block.begin(), block.end());
      if (buffer.size() < kWriteBytes && n + 1 < rows.size()) continue;
      LUMIGRID_TRY(file.write(buffer));
      buffer.clear();
      const double done = (of_caster ? 0.5 : 0.0) + 0.5 * static_cast<double>(n + 1) / static_cast<double>(rows.size());
      if (progress && !progress(done))
        return base::Error{base::ErrorCode::kCancelled, "writing the nodes was cancelled"};
    }
  }
  LUMIGRID_TRY(file.commit());
  return header;
}

}  // namespace lod::hlod::builder
