#pragma once
// The records of groups for clients of a static host: all that the tables of patch.lgp say of a group, in a fourth
// of the bytes. A record has what places a group in the hierarchy ("One group as bytes" in docs/formats/patch.md).
// Sixteen make a chunk, which is read by itself, so a client reads those that its views lead to.
// docs/formats/records.md defines every bit.
//
// Bounds are rounded outwards and errors upwards: boxes and spheres by a small part of a patch, errors by at most a
// 64th, cones by at most 2.5 degrees. So whatever holds of the tables' bounds holds of these.
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// The numbers of the header.
struct RecordCounts {
  static constexpr std::uint64_t kHeaderBytes = 96;

  std::uint64_t object_bytes = 0;  ///< of the records
  std::uint64_t front_bytes = 0;   ///< header and directory
  std::uint64_t patch_bytes = 0;   ///< length of the patch.lgp that has the blocks
  Lattice lattice;
  bool has_colors = false;
  std::uint64_t source_triangles = 0;
  std::uint32_t groups = 0, patches = 0;
};

/// Writes the records of a whole hierarchy. `patch_bytes`: length of its patch.lgp. The same tables give the same
/// bytes.
base::Bytes encodeRecords(const Hierarchy& hierarchy, std::uint64_t patch_bytes);

/// The chunks that have come, decoded. Hostile bytes are an error, never more than some hundred times their memory.
class GroupRecords {
 public:
  static constexpr std::uint32_t kGroupsPerChunk = 16;

  /// Reads header and directory from the object's first bytes, which hold both, and all chunks that they hold to the
  /// end.
  static base::Result<GroupRecords> open(base::ByteView front);
  const RecordCounts& counts() const { return counts_; }

  std::uint32_t chunkCount() const { return static_cast<std::uint32_t>(offsets_.size() - 1); }
  static std::uint32_t chunkOf(std::uint32_t group) { return group / kGroupsPerChunk; }
  std::uint64_t chunkOffset(std::uint32_t chunk) const { return offsets_[chunk]; }
  std::uint64_t chunkBytes(std::uint32_t chunk) const { return offsets_[chunk + 1] - offsets_[chunk]; }
  bool has(std::uint32_t chunk) const { return chunks_.count(chunk) != 0; }
  /// Takes a chunk, of chunkBytes(). kInvalidInput where it is damaged: its groups stay unknown.
  base::Result<void> add(std::uint32_t chunk, base::ByteView bytes);

  /// Null while the group's chunk is not here. `group` is below counts().groups.
  const Group* row(std::uint32_t group) const;
  /// One group as bytes, for addGroup(); empty while its chunk is not here.
  base::ByteView record(std::uint32_t group) const;
  /// The number of groups from group 0 on that are all here.
  std::uint32_t leadingGroups() const;

 private:
  struct Chunk {
    std::vector<Group> rows;
    std::vector<base::Bytes> records;  // beside `rows`
  };
  /// Nothing where the bytes are damaged.
  std::optional<Chunk> decodeChunk(base::ByteView bytes, std::uint32_t first_group, std::uint32_t count) const;

  RecordCounts counts_;
  std::vector<std::uint64_t> offsets_;  // of chunks, and the object's end
  std::unordered_map<std::uint32_t, Chunk> chunks_;
};

}  // namespace lod::patch
