#pragma once
// The built nodes on disk, and the file that is made of them.
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lod/hlod/builder/node_build.h"
#include "lod/hlod/builder/octree.h"
#include "lod/ingest/record_log.h"

namespace lod::hlod::builder {

/// The nodes of all cells on disk, which is also the journal of the nodes that are done.
class NodeStore {
 public:
  /// Creates `path`, or with `resume` reads and continues it. Errors: kNoSpace, kIo.
  static base::Result<NodeStore> open(const std::string& path, bool resume, std::size_t cells);
  bool has(std::uint32_t cell) const { return stored_[cell].has_value(); }
  /// Safe from several threads. Errors: kNoSpace, kIo.
  base::Result<void> add(std::uint32_t cell, const BuiltNode& node);
  std::uint64_t bytes() const { return log_.size(); }

  /// Only for a cell that is there.
  const Node& row(std::uint32_t cell) const { return stored_[cell]->row; }
  std::uint64_t meshTriangles(std::uint32_t cell) const { return stored_[cell]->mesh_triangles; }
  std::uint64_t meshVertices(std::uint32_t cell) const { return stored_[cell]->mesh_vertices; }
  std::uint64_t meshPoints(std::uint32_t cell) const { return stored_[cell]->mesh_points; }
  /// Errors: those of reading, damaged work files.
  base::Result<NodeMesh> readMesh(std::uint32_t cell) const;
  base::Result<base::Bytes> readBlock(std::uint32_t cell, bool of_caster) const;

 private:
  struct Stored {
    Node row;
    std::uint32_t mesh_triangles = 0, mesh_vertices = 0, mesh_points = 0;
    std::uint32_t mesh_bytes = 0;
    std::uint64_t offset = 0;  // of the picture in the log; caster and mesh follow
  };
  bool keep(std::uint64_t offset, base::ByteView payload);
  base::Result<base::Bytes> read(std::uint64_t offset, std::uint64_t bytes) const;

  ingest::RecordLog log_;
  std::vector<std::optional<Stored>> stored_;  // each is written by the one thread that adds it
};

/// Sets the links of all rows, and boxes, cones and errors so that those of parents contain those of children.
std::vector<Node> linkedRows(const NodeStore& store, const std::vector<Cell>& cells);

/// Writes the file at `path`; it appears whole or not at all. `header` has colours, lattice and triangles; the rest is
/// filled in. `progress` gets the share done, and cancels by false. Errors: kNoSpace, kIo, kCancelled.
base::Result<Header> writeFile(const NodeStore& store, std::vector<Node> rows, Header header, const std::string& path,
                               const std::function<bool(double)>& progress);

}  // namespace lod::hlod::builder
